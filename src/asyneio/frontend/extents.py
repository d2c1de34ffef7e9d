"""What of the front end is a share of the sensor and not a number of pixels.

A patch is read pixel by pixel, so its size, its steps and its errors are pixels whatever the sensor. How
features lie in the image, and over which part of it they move alike, is a matter of the view: the same view
on more pixels must give the same spread of features.
"""

from __future__ import annotations

#: No matter how few columns a sensor has, features are so far apart: nearer ones read the same events.
LEAST_SPACING_PX = 10.0
#: Features within this share of the width move alike: as far as the image is smooth enough to guess from.
_NEIGHBOURS = 0.25


def spacing_px(share: float, width: int) -> float:
    """Distance [px] to active features that a corner needs, from the share of the sensor's width."""
    return max(LEAST_SPACING_PX, share * width)


def neighbourhood_px(width: int) -> float:
    """How far [px] features are whose velocity a new one may begin its search with."""
    return _NEIGHBOURS * width
