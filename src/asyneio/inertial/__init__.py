"""Inertial measurements: dead reckoning between knots."""
