"""Inertial measurements: dead reckoning between knots; preintegration by discrete rules and by GPs."""
