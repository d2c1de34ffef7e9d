"""Scenarios of feature tracks, without events."""
