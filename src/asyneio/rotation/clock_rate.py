# SPDX-License-Identifier: Apache-2.0
"""Rate of the camera's clock relative to the gyroscope's: an offset that changes linearly.

`alignment.py` finds a constant offset. If one clock runs some tenths of a percent fast, the offset changes
over a recording, and any single offset fits only a part of it. Here, rates are tested as well. A rate is
accepted if it explains the rotation far better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.rotation.alignment import CONTRADICTED, OFFSET_OBSERVABLE_S, RELATED, Alignment, align
from asyneio.rotation.camera_rates import CameraRates
from asyneio.rotation.noise import spread
from asyneio.rotation.time_offset import TurnOf
from asyneio.types import NS_PER_S, FloatArray, RecordArray

#: Range and steps of the search: relative rate, and offset at the first window [s].
_MOST_RATE, _RATE_STEP = 0.05, 0.001
_REACH_S, _STEP_S = 0.3, 0.02
_FINER = (0.0005, 0.00025, 0.000125)
#: Part of the recording that is compared [s], least part, and least number of windows.
_SPAN_S, _LEAST_SPAN_S, _LEAST_WINDOWS = 30.0, 8.0, 30
#: A smaller rate is that of two quartz clocks, or of a poor fit.
_LEAST_RATE = 0.001
#: Logarithm of the number of rates and offsets that are tested.
_OF_MANY = 9.0


@dataclass(frozen=True)
class ClockRate:
    """Rate of the camera's clock.

    Attributes:
        rate: by which it runs fast: a second of the IMU's clock takes `1 + rate` seconds of the camera's.
        start_s, end_s: offsets to be added to the camera clock at the start and the end of the windows [s].
    """

    rate: float
    start_s: float
    end_s: float

    def text(self, shift_s: float = 0.0) -> str:
        """The finding, as a phrase; `shift_s` is what was added to the camera clock before."""
        side = "fast" if self.rate > 0.0 else "slow"
        return (
            f"the camera's clock runs {100.0 * abs(self.rate):.2f} % {side}: t_imu = t_cam "
            f"{1e3 * (self.start_s + shift_s):+.0f} ms at first, {1e3 * (self.end_s + shift_s):+.0f} ms at "
            "the end of the comparison"
        )

    def fix(self) -> str:
        """What to do."""
        return (
            "no single offset fits: record both with one clock, or multiply the steps of the camera's time "
            f"stamps by {1.0 / (1.0 + self.rate):.5f}"
        )


def find_clock_rate(
    rates: CameraRates, gyroscope: RecordArray, claimed: FloatArray, around_s: float
) -> ClockRate | None:
    """The rate of the camera's clock, if it explains far more than equal rates; None otherwise.

    Args: as those of `alignment.align`.
    """
    if rates.count < _LEAST_WINDOWS:
        return None
    near = rates.start_ns - rates.start_ns[0] <= _SPAN_S * NS_PER_S
    rates = CameraRates(rates.start_ns[near], rates.end_ns[near], rates.omega[near])
    span_s = float(np.ptp(rates.start_ns)) / NS_PER_S
    if rates.count < _LEAST_WINDOWS or span_s < _LEAST_SPAN_S:
        return None
    rate, offset_s = _search(rates, TurnOf(gyroscope), around_s)
    if abs(rate) < _LEAST_RATE:
        return None
    equal = align(rates, gyroscope, claimed, around_s)
    found = align(slowed(rates, rate), gyroscope, claimed, offset_s)
    if found is None or not _accepted(found, equal):
        return None
    end_s = found.offset_s + span_s * (1.0 / (1.0 + rate) - 1.0)
    return ClockRate(rate, found.offset_s, end_s)


def _accepted(found: Alignment, equal: Alignment | None) -> bool:
    observed = found.explained > RELATED and found.offset_sigma_s <= OFFSET_OBSERVABLE_S
    return observed and (equal is None or found.likelier_than(equal) > CONTRADICTED + _OF_MANY)


def slowed(rates: CameraRates, rate: float) -> CameraRates:
    """Rates in the time of a clock that agrees at the first window and does not run fast by `rate`."""
    first = int(rates.start_ns[0])
    start_ns, end_ns = (
        first + np.rint((stamps - first) / (1.0 + rate)).astype(np.int64)
        for stamps in (rates.start_ns, rates.end_ns)
    )
    return CameraRates(start_ns, end_ns, rates.omega * (1.0 + rate))


def _search(rates: CameraRates, turn: TurnOf, around_s: float) -> tuple[float, float]:
    """Rate and offset [s] with the smallest residuals of a linear map from body to camera rates."""
    limit = 3.0 * spread(rates.omega)
    clipped = CameraRates(rates.start_ns, rates.end_ns, np.clip(rates.omega, -limit, limit))
    steps = np.arange(-round(_MOST_RATE / _RATE_STEP), round(_MOST_RATE / _RATE_STEP) + 1) * _RATE_STEP
    reach = np.arange(-round(_REACH_S / _STEP_S), round(_REACH_S / _STEP_S) + 1) * _STEP_S
    best = _best(clipped, turn, steps.tolist(), (around_s + reach).tolist())
    for finer in _FINER:
        near = [best[1] + 20.0 * finer * k for k in range(-2, 3)]
        best = _best(clipped, turn, [best[0] + finer * k for k in (-1, 0, 1)], near)
    return best


def _best(
    rates: CameraRates, turn: TurnOf, trial_rates: list[float], offsets_s: list[float]
) -> tuple[float, float]:
    found = (float("inf"), 0.0, offsets_s[len(offsets_s) // 2])
    for rate in trial_rates:
        trial = slowed(rates, rate)
        for offset_s in offsets_s:
            found = min(found, (_cost(trial, turn, offset_s), rate, offset_s))
    return found[1], found[2]


def _cost(rates: CameraRates, turn: TurnOf, offset_s: float) -> float:
    """Logarithm of the share of the rates that is not explained; infinite if too little is covered."""
    body, inside = turn.means(rates, offset_s)
    count = int(np.count_nonzero(inside))
    if count < 0.8 * rates.count:
        return float("inf")
    design, seen = np.column_stack([body[inside], np.ones(count)]), rates.omega[inside]
    normal = design.T @ design + 1e-3 * np.eye(4)
    left = seen - design @ np.linalg.solve(normal, design.T @ seen)
    return float(np.log((left**2).mean(axis=0) / (seen**2).mean(axis=0) + 1e-6).sum())
