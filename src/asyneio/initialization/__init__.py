"""From nothing to a first window: visual-inertial alignment and warm-up."""
