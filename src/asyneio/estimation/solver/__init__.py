"""Levenberg-Marquardt, landmark elimination, chi-square test, marginalization and covariance."""
