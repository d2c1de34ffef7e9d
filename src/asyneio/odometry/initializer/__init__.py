"""Initialization of a segment: the first window from a known state, stationary or in motion, and its
checks."""
