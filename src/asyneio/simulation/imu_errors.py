# SPDX-License-Identifier: Apache-2.0
"""Errors of inertial sensors: the tolerances of a sensor model, and the errors of one unit drawn from them.

The errors of a unit are drawn once and stay constant. Each random part has its own random generator, so that
disabling one of them does not change the others.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from asyneio.errors import SimulationError
from asyneio.types import NS_PER_S, FloatArray, IntArray


@dataclass(frozen=True)
class StreamErrors:
    """Errors of one stream of an IMU model; all are disabled by default.

    Units are rad/s or m/s^2. Standard deviations are over the units of the model.

    Attributes:
        full_scale: readings saturate at plus and minus this value [unit].
        quantum: resolution of the readings [unit]; 0 for none.
        bandwidth_hz: half-power frequency of the low-pass filter, a Butterworth; infinite for no filter.
        order: order of the filter.
        delay_s: group delay of the whole chain for slow motion [s]; None for that of the filter alone.
        update_rate_hz: rate at which readings are updated; faster outputs repeat the last reading. None:
            every output is a new reading.
        scale_sigma: standard deviation of the scale factor of an axis.
        misalignment_sigma: standard deviation of each cross-axis term [rad].
        g_sensitivity_sigma: standard deviation of each element of the gyroscope's sensitivity to specific
            force [rad/s per m/s^2].
        temperature_sigma: standard deviation of the temperature coefficient of the bias [unit/K].
        stamp_delay_s: delay of the timestamps in addition to the calibration's time shift [s].
        stamp_jitter_s: standard deviation of the error of a timestamp [s].
        lost_share: probability that a sample is lost, 0 to 1.

    Raises:
        SimulationError: a value is invalid.
    """

    full_scale: float = np.inf
    quantum: float = 0.0
    bandwidth_hz: float = np.inf
    order: int = 2
    delay_s: float | None = None
    update_rate_hz: float | None = None
    scale_sigma: float = 0.0
    misalignment_sigma: float = 0.0
    g_sensitivity_sigma: float = 0.0
    temperature_sigma: float = 0.0
    stamp_delay_s: float = 0.0
    stamp_jitter_s: float = 0.0
    lost_share: float = 0.0

    def __post_init__(self) -> None:
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        set_ = {name: value for name, value in given.items() if value is not None}
        wrong = [f"{name} = {value}" for name, value in set_.items() if not value >= 0.0]
        positive = ("full_scale", "bandwidth_hz", "order", "update_rate_hz")
        wrong += [f"{name} = {set_[name]}" for name in positive if set_.get(name) == 0.0]
        wrong += [f"lost_share = {self.lost_share}"] if self.lost_share >= 1.0 else []
        if wrong:
            raise SimulationError(
                f"{', '.join(wrong)}; expected no negative value, a positive full scale, bandwidth, "
                "order and update rate, and a lost_share below 1"
            )


@dataclass(frozen=True)
class Unit:
    """Errors of one unit: reading = `gain` (3,3) truth + `g_sensitivity` (3,3) specific force + bias.

    `temperature` (3,) is the temperature coefficient of the bias [unit/K].
    """

    gain: FloatArray
    g_sensitivity: FloatArray
    temperature: FloatArray


@dataclass(frozen=True)
class StreamRandomness:
    """Random generators of the errors of one stream."""

    gain: np.random.Generator
    g_sensitivity: np.random.Generator
    temperature: np.random.Generator
    update: np.random.Generator
    jitter: np.random.Generator
    losses: np.random.Generator

    @classmethod
    def spawned(cls, parent: np.random.Generator) -> StreamRandomness:
        """Generators from the children of `rng`, whose own state does not change."""
        return cls(*parent.spawn(len(fields(cls))))


def draw_unit(errors: StreamErrors, random: StreamRandomness, defines_axes: bool) -> Unit:
    """Draw a unit of a sensor model.

    Args:
        errors: tolerances of the model.
        random: random generators.
        defines_axes: the calibration against the camera defines the body axes by this stream, so its
            misalignment contains no rotation. This is the case for the gyroscope.
    """
    scale = random.gain.normal(size=3)
    cross = random.gain.normal(size=(3, 3))
    np.fill_diagonal(cross, 0.0)
    if defines_axes:
        # The mean of two independent values would have a standard deviation smaller by the square root of
        # two.
        cross = (cross + cross.T) / np.sqrt(2.0)
    gain = np.eye(3) + np.diag(errors.scale_sigma * scale) + errors.misalignment_sigma * cross
    g_sensitivity = errors.g_sensitivity_sigma * random.g_sensitivity.normal(size=(3, 3))
    return Unit(gain, g_sensitivity, errors.temperature_sigma * random.temperature.normal(size=3))


def digitised(values: FloatArray, errors: StreamErrors) -> FloatArray:
    """Readings (N,3) of an analog-to-digital converter: clipped at full scale and quantised.

    The positive end is one step below full scale, as in two's complement.
    """
    if not errors.quantum > 0.0:
        return np.clip(values, -errors.full_scale, errors.full_scale)
    steps = np.rint(values / errors.quantum)
    if np.isfinite(errors.full_scale):
        most = np.rint(errors.full_scale / errors.quantum)
        steps = np.clip(steps, -most, most - 1.0)
    # Avoid negative zeros.
    return np.asarray(steps * errors.quantum + 0.0)


def update_times(
    errors: StreamErrors, t_s: FloatArray, output_hz: float, rng: np.random.Generator
) -> tuple[float, float, IntArray]:
    """Updates of the readings, for outputs at equally spaced times (N,) [s].

    Returns: time of the first update [s], rate of the updates [Hz], and index of the update of each output
    (N,).
    """
    if errors.update_rate_hz is None:
        return float(t_s[0]), output_hz, np.arange(t_s.size)
    rate_hz = errors.update_rate_hz
    # The clocks of sensor and reader are independent.
    first_s = float(t_s[0] - rng.uniform(0.0, 1.0) / rate_hz)
    return first_s, rate_hz, np.floor((t_s - first_s) * rate_hz + 1e-9).astype(np.int64)


def stamps(t_ns: IntArray, errors: StreamErrors, random: StreamRandomness) -> tuple[IntArray, IntArray]:
    """Ascending timestamps (M,) [ns] of samples taken at times (N,) [ns], and indices of the kept samples
    (M,)."""
    jitter = random.jitter.normal(size=t_ns.size)
    kept = random.losses.random(t_ns.size) >= errors.lost_share
    late_s = errors.stamp_delay_s + errors.stamp_jitter_s * jitter
    order = np.arange(t_ns.size)
    # A driver delivers samples in order: each timestamp is later than the one before.
    stamped = np.maximum.accumulate(t_ns + np.rint(late_s * NS_PER_S).astype(np.int64) - order) + order
    return stamped[kept], np.flatnonzero(kept)
