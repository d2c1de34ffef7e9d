# SPDX-License-Identifier: Apache-2.0
"""Check that all readings of a sensor are from one sensor: two mixed ones alternate between two values.

In a few milliseconds a rotation rate or a force hardly changes. In the readings of two sensors of different
scale or axes there are two groups of values in each short window, far apart, which alternate in time. Motion
gives groups that do not alternate; vibration gives no two groups, or none in most windows.
"""

from __future__ import annotations

import numpy as np

from asyneio.doctor.checks.imu_time import streams_of
from asyneio.doctor.inspection import Inspection, fail
from asyneio.doctor.result import CheckResult
from asyneio.types import FloatArray

#: Readings of a window, and the longest duration of one [ns].
_LENGTH, _LONGEST_NS = 24, 300_000_000
#: Least readings of each group, and least changes between the groups in a window.
_LEAST, _LEAST_CHANGES = 4, 5
#: Least distance of the groups: in standard deviations inside them, and relative to the largest reading.
_SIGMAS, _RELATIVE = 6.0, 0.2
#: Windows with smaller readings [rad/s, m/s^2] show nothing; least number and share of the others. The share
#: is at most 0.006 in real recordings (hand-held, rotating disk, drone), 0.18 and more where two are mixed.
_LEAST_READING = {"gyroscope": 0.2, "accelerometer": 2.0}
_LEAST_WINDOWS, _SHARE = 5, 0.15


def check_one_source(inspection: Inspection) -> CheckResult | None:
    """Readings of two sensors in one stream; no result if there is one sensor."""
    shares = {
        name: share_of_two(t_ns, xyz, _LEAST_READING[name]) for name, t_ns, xyz in streams_of(inspection)
    }
    found = {name: share for name, share in shares.items() if share >= _SHARE}
    if not found:
        return None
    measured = "; ".join(
        f"{name}: the readings alternate between two values in {share:.0%} of the short windows with motion"
        for name, share in found.items()
    )
    return fail(
        "imu sources",
        measured,
        "readings of one sensor, which change continuously",
        "two sensors (or two topics, ranges or axis conventions) are mixed in one stream: separate them, and "
        "use one",
        shares=shares,
    )


def share_of_two(t_ns: np.ndarray, xyz: FloatArray, least: float) -> float:
    """Share of the windows of readings (N,3), with magnitudes above `least`, that contain two groups.

    Zero with too few windows.
    """
    count = len(xyz) // _LENGTH
    if count < _LEAST_WINDOWS:
        return 0.0
    windows = xyz[: count * _LENGTH].reshape(count, _LENGTH, 3)
    times = t_ns[: count * _LENGTH].reshape(count, _LENGTH)
    largest = np.linalg.norm(windows, axis=2).max(axis=1)
    duration = times[:, -1] - times[:, 0]
    used = np.isfinite(largest) & (largest > least) & (duration > 0) & (duration < _LONGEST_NS)
    if np.count_nonzero(used) < _LEAST_WINDOWS:
        return 0.0
    return float(np.mean([_two(w, size) for w, size in zip(windows[used], largest[used], strict=True)]))


def _two(window: FloatArray, largest: float) -> bool:
    """Whether the readings (N,3) of a window alternate between two groups."""
    axis = int(np.argmax(np.ptp(window, axis=0)))
    values = window[:, axis]
    ordered = np.sort(values)
    inner = np.diff(ordered)[_LEAST - 1 : -(_LEAST - 1)]
    cut = int(np.argmax(inner)) + _LEAST
    upper = values >= ordered[cut]
    if upper.all() or np.count_nonzero(upper) < _LEAST or np.count_nonzero(~upper) < _LEAST:
        return False
    high, low = window[upper], window[~upper]
    distance = float(np.linalg.norm(high.mean(axis=0) - low.mean(axis=0)))
    inside = float(np.sqrt(max(high[:, axis].var(), low[:, axis].var())))
    changes = int(np.count_nonzero(upper[1:] != upper[:-1]))
    return changes >= _LEAST_CHANGES and distance > max(_SIGMAS * inside, _RELATIVE * largest)
