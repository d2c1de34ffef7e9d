"""What distinguishes a real inertial stream from an ideal one: a record of figures, and a unit drawn from it.

The figures of a model of sensor are tolerances; a unit is drawn from them once and keeps its errors. Each
random part has a stream of its own, so that switching one of them off leaves the others as they were.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from asyneio.errors import SimulationError
from asyneio.types import NS_PER_S, FloatArray, IntArray


@dataclass(frozen=True)
class StreamErrors:
    """How one stream of a model of IMU differs from the truth; everything is off by default.

    The unit is rad/s or m/s^2. Standard deviations are from one unit of the model to another.

    Attributes:
        full_scale: readings end at plus and minus this [unit].
        quantum: step of the readings [unit]; 0 for none.
        bandwidth_hz: half-power frequency of the low-pass filter, a Butterworth; infinite for no filter.
        order: of the filter.
        delay_s: group delay of the whole chain for slow motion; None for that of the filter alone.
        update_rate_hz: how often a reading is renewed; a reader that asks more often gets the last one
            again. None: at every output.
        scale_sigma: of the scale factor of an axis.
        misalignment_sigma: of each cross-axis share [rad].
        g_sensitivity_sigma: of each element of what specific force adds to the angular velocity
            [rad/s per m/s^2]; for gyroscopes.
        temperature_sigma: of the change of the bias with temperature [unit/K].
        stamp_delay_s: how late stamps are, over what the calibration's time shift contains.
        stamp_jitter_s: standard deviation of a stamp's error.
        lost_share: of the samples, each by itself, 0 to 1.

    Raises:
        SimulationError: a figure is impossible.
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
                f"{', '.join(wrong)}; expected no negative figure, a positive full scale, bandwidth, "
                "order and update rate, and a share of lost samples below 1"
            )


@dataclass(frozen=True)
class Unit:
    """Errors of one unit: reading = `gain` (3,3) truth + `g_sensitivity` (3,3) specific force + bias, and
    `temperature` (3,) [unit/K] of the bias."""

    gain: FloatArray
    g_sensitivity: FloatArray
    temperature: FloatArray


@dataclass(frozen=True)
class StreamRandomness:
    """Generators of one stream's errors."""

    gain: np.random.Generator
    g_sensitivity: np.random.Generator
    temperature: np.random.Generator
    update: np.random.Generator
    jitter: np.random.Generator
    losses: np.random.Generator

    @classmethod
    def spawned(cls, parent: np.random.Generator) -> StreamRandomness:
        """From children of a generator, which is itself left as it was."""
        return cls(*parent.spawn(len(fields(cls))))


def draw_unit(errors: StreamErrors, random: StreamRandomness, defines_axes: bool) -> Unit:
    """A unit of a model of sensor.

    Args:
        errors: of the model.
        random: generators.
        defines_axes: the axes of the body are, by calibration against the camera, those of this stream: then
            its misalignment has no part that is a rotation. So it is with the gyroscope.
    """
    scale = random.gain.normal(size=3)
    cross = random.gain.normal(size=(3, 3))
    np.fill_diagonal(cross, 0.0)
    if defines_axes:
        # Of the mean of two that are independent, the deviation would be smaller by the root of two.
        cross = (cross + cross.T) / np.sqrt(2.0)
    gain = np.eye(3) + np.diag(errors.scale_sigma * scale) + errors.misalignment_sigma * cross
    g_sensitivity = errors.g_sensitivity_sigma * random.g_sensitivity.normal(size=(3, 3))
    return Unit(gain, g_sensitivity, errors.temperature_sigma * random.temperature.normal(size=3))


def digitised(values: FloatArray, errors: StreamErrors) -> FloatArray:
    """Readings (N,3) of an analog-to-digital converter: clipped at full scale, in whole steps.

    The positive end is one step short of full scale, as of a two's complement number.
    """
    if not errors.quantum > 0.0:
        return np.clip(values, -errors.full_scale, errors.full_scale)
    steps = np.rint(values / errors.quantum)
    if np.isfinite(errors.full_scale):
        most = np.rint(errors.full_scale / errors.quantum)
        steps = np.clip(steps, -most, most - 1.0)
    # Zero has no sign.
    return np.asarray(steps * errors.quantum + 0.0)


def update_times(
    errors: StreamErrors, t_s: FloatArray, output_hz: float, rng: np.random.Generator
) -> tuple[float, float, IntArray]:
    """When readings are renewed, for outputs at times (N,) [s], evenly spaced at a rate.

    Returns: the first renewal [s], the rate [Hz], and (N,) which renewal an output shows.
    """
    if errors.update_rate_hz is None:
        return float(t_s[0]), output_hz, np.arange(t_s.size)
    rate_hz = errors.update_rate_hz
    # The clocks of sensor and reader do not know each other.
    first_s = float(t_s[0] - rng.uniform(0.0, 1.0) / rate_hz)
    return first_s, rate_hz, np.floor((t_s - first_s) * rate_hz + 1e-9).astype(np.int64)


def stamps(t_ns: IntArray, errors: StreamErrors, random: StreamRandomness) -> tuple[IntArray, IntArray]:
    """Ascending stamps (M,) [ns] of samples taken at times (N,) [ns], and which samples remain (M,)."""
    jitter = random.jitter.normal(size=t_ns.size)
    kept = random.losses.random(t_ns.size) >= errors.lost_share
    late_s = errors.stamp_delay_s + errors.stamp_jitter_s * jitter
    order = np.arange(t_ns.size)
    # A driver hands samples over in their order: a stamp is later than the one before.
    stamped = np.maximum.accumulate(t_ns + np.rint(late_s * NS_PER_S).astype(np.int64) - order) + order
    return stamped[kept], np.flatnonzero(kept)
