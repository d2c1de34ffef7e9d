# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt, landmark elimination, chi-square test, marginalization and covariance."""
