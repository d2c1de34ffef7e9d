# SPDX-License-Identifier: Apache-2.0
"""Sliding window: problem arrays, linearisation, Levenberg-Marquardt, marginalisation, covariance."""
