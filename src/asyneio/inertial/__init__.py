# SPDX-License-Identifier: Apache-2.0
"""Inertial measurements: dead reckoning between knots; preintegration by discrete rules and by GPs."""
