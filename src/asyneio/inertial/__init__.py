"""Inertial measurements: dead reckoning between knots, and preintegration by two discrete rules and by GPs."""
