"""Initialization of the first window: consensus of tracks, visual-inertial alignment, adjustment, warm-up."""
