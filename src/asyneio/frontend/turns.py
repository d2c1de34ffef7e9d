"""How the image rolls while a packet of events is processed."""

from __future__ import annotations

import numpy as np

#: From the event of that index on, the image rolls at this rate [rad/s], x towards y.
TURN_DTYPE = np.dtype([("first", "<i8"), ("rate", "<f8")])

#: Not at all.
STILL = np.zeros(1, dtype=TURN_DTYPE)
