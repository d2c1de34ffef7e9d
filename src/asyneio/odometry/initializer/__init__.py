# SPDX-License-Identifier: Apache-2.0
"""Initialization of a segment: the first window from a known state, stationary or in motion, and its
checks."""
