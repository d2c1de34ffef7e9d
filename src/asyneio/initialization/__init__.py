# SPDX-License-Identifier: Apache-2.0
"""Initialization of the first window: consensus of tracks, visual-inertial alignment, adjustment, warm-up."""
