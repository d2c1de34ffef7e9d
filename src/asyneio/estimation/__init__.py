"""Sliding window: problem arrays, linearisation, Levenberg-Marquardt, marginalisation, covariance."""
