# SPDX-License-Identifier: Apache-2.0
"""Lengths of the front end that scale with the sensor.

A patch is matched pixel by pixel, so its size, its steps and its errors are in pixels on every sensor. The
spacing of features and the distance over which they move alike depend on the field of view instead: the same
view on more pixels must give the same distribution of features.
"""

from __future__ import annotations

#: Least spacing on any sensor: features that are closer share the same events.
LEAST_SPACING_PX = 10.0
#: Features within this share of the width move alike.
_NEIGHBOURS = 0.25


def spacing_px(share: float, width: int) -> float:
    """Least distance [px] of a corner from all features, given as a share of the sensor's width."""
    return max(LEAST_SPACING_PX, share * width)


def neighbourhood_px(width: int) -> float:
    """Largest distance [px] of the features whose velocity is the initial guess for a new one."""
    return _NEIGHBOURS * width
