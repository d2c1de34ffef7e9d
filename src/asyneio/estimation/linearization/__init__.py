# SPDX-License-Identifier: Apache-2.0
"""Residuals and Jacobians of each kind of factor, summed into the normal equations."""
