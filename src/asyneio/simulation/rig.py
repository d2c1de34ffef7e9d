# SPDX-License-Identifier: Apache-2.0
"""The simulated rig: its calibration, its IMU samples and their ground truth.

Errors are applied in the order of the signal: motion of the housing, with vibration; scale, misalignment and
the gyroscope's sensitivity to specific force; white noise; low-pass filter; sampling at the sensor's own
rate; bias; full scale and quantisation; reading at the output's rate; stamps.

The ground truth follows three conventions:

1. The true bias is the part of the readings that does not depend on the motion: the initial bias, its walk,
   and its drift with temperature. Scale, misalignment and sensitivity to specific force are not part of it;
   an estimator without a model of them finds an accelerometer bias that differs by about `scale * 9.8 m/s^2`.
2. The body axes are the gyroscope's axes.
3. Timestamps are late by the delay of the filter, as those of real sensors. A calibration measures this
   delay, so the gyroscope's delay is contained in `timeshift_ns`. In the IMU clock, which is that of the
   ground truth, the gyroscope is on time for slow motion, and the accelerometer is late by the difference of
   the two delays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from asyneio.simulation.imu import (
    BiasWalk,
    StreamSpec,
    as_records,
    corrupt,
    draw_bias,
    sample_times,
    specific_force_b,
)
from asyneio.simulation.imu_errors import (
    StreamErrors,
    StreamRandomness,
    digitised,
    draw_unit,
    stamps,
    update_times,
)
from asyneio.simulation.imu_filter import Signal, group_delay_s, sampled
from asyneio.simulation.motion import Motion
from asyneio.simulation.tracks.scenario import RigScenario
from asyneio.simulation.truth import Truth
from asyneio.simulation.vibration import draw_tones
from asyneio.types import NS_PER_S, Calibration, FloatArray, IntArray, RecordArray

#: Camera axes (x right, y down, z forward) in the carrier frame (x forward, y left, z up), as columns.
C_F_C = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class InertialRun:
    """Both streams (INERTIAL_DTYPE, IMU clock) and the ground truth of the run."""

    gyroscope: RecordArray
    accelerometer: RecordArray
    truth: Truth


def simulate_inertial(
    scenario: RigScenario,
    motion: Motion,
    for_gyroscope: np.random.Generator,
    for_accelerometer: np.random.Generator,
) -> InertialRun:
    """Simulate the IMU of a scenario along a motion, with one random generator for each sensor.

    Raises:
        SimulationError: a stream cannot be simulated.
    """
    imu = scenario.imu
    (for_vibration,) = for_gyroscope.spawn(1)
    shaking, pushing = draw_tones(scenario.vibration, for_vibration)
    of_gyroscope = StreamRandomness.spawned(for_gyroscope)
    of_accelerometer = StreamRandomness.spawned(for_accelerometer)
    unit = draw_unit(imu.gyroscope, of_gyroscope, defines_axes=True)
    other = draw_unit(imu.accelerometer, of_accelerometer, defines_axes=False)

    def force(t_s: FloatArray) -> FloatArray:
        """Specific force with vibration (N,3) [m/s^2, body] at times (N,) [s]."""
        return specific_force_b(motion, t_s, scenario.gravity) + pushing.at(t_s)

    def turning(t_s: FloatArray) -> FloatArray:
        """Angular velocity as the gyroscope's axes measure it (N,3) [rad/s] at times (N,) [s]."""
        rate = (motion.angular_velocity_b(t_s) + shaking.at(t_s)) @ unit.gain.T
        if not unit.g_sensitivity.any():
            return rate
        return rate + force(t_s) @ unit.g_sensitivity.T

    def pulling(t_s: FloatArray) -> FloatArray:
        """Specific force as the accelerometer's axes measure it (N,3) [m/s^2] at times (N,) [s]."""
        return force(t_s) @ other.gain.T

    ahead_s = group_delay_s(imu.gyroscope)
    gyroscope = _Stream(scenario, scenario.gyroscope, imu.gyroscope, turning, unit.temperature, ahead_s)
    accelerometer = _Stream(
        scenario, scenario.accelerometer, imu.accelerometer, pulling, other.temperature, ahead_s
    )
    read, bias_gyroscope = _read(gyroscope, for_gyroscope, of_gyroscope)
    pulled, bias_accelerometer = _read(accelerometer, for_accelerometer, of_accelerometer)
    end_ns = scenario.start_ns + round(scenario.duration_s * NS_PER_S)
    truth = Truth(scenario.start_ns, end_ns, motion, bias_gyroscope, bias_accelerometer)
    return InertialRun(read, pulled, truth)


def calibration_of(scenario: RigScenario) -> Calibration:
    """The true calibration of a scenario."""
    noise = scenario.noise
    if scenario.gyroscope_rate_hz == scenario.accelerometer_rate_hz:
        # The calibration can declare only one rate.
        noise = replace(noise, rate_hz=scenario.gyroscope_rate_hz)
    return Calibration(scenario.camera, scenario.T_b_c, scenario.timeshift_ns, noise)


@dataclass(frozen=True)
class _Stream:
    """One stream: `signal` is its true input, `temperature` (3,) its temperature coefficient [unit/K], and
    `ahead_s` the time by which the calibration's clock is ahead of the sensor's [s]."""

    scenario: RigScenario
    spec: StreamSpec
    errors: StreamErrors
    signal: Signal
    temperature: FloatArray
    ahead_s: float


def _read(
    stream: _Stream, rng: np.random.Generator, random: StreamRandomness
) -> tuple[RecordArray, BiasWalk]:
    """Records of a stream, and its bias; `rng` gives bias and white noise."""
    scenario, errors = stream.scenario, stream.errors
    t_ns = sample_times(stream.spec, scenario.duration_s)
    bias = draw_bias(stream.spec, t_ns, rng)
    warmer_k = -scenario.imu.warming_k * np.expm1(-bias.t_ns / NS_PER_S / scenario.imu.warming_s)
    bias = replace(bias, value=bias.value + warmer_k[:, None] * stream.temperature)
    xyz = digitised(_values(stream, t_ns, bias, rng, random), errors)
    stamped_ns, kept = stamps(t_ns, errors, random)
    inside = (stamped_ns >= 0) & (stamped_ns <= round(scenario.duration_s * NS_PER_S))
    return as_records(scenario.start_ns + stamped_ns[inside], xyz[kept[inside]]), bias


def _values(
    stream: _Stream,
    t_ns: IntArray,
    bias: BiasWalk,
    rng: np.random.Generator,
    random: StreamRandomness,
) -> FloatArray:
    """Readings (N,3) at times (N,) [ns] before quantisation."""
    errors, spec = stream.errors, stream.spec
    t_s = t_ns / NS_PER_S
    if np.isinf(errors.bandwidth_hz) and errors.delay_s is None and errors.update_rate_hz is None:
        return corrupt(stream.signal(t_s + stream.ahead_s), t_ns, bias, spec, rng)
    first_s, rate_hz, shown = update_times(errors, t_s, spec.rate_hz, random.update)
    count = int(shown[-1]) + 1
    values = sampled(
        lambda times_s: stream.signal(times_s + stream.ahead_s),
        first_s,
        rate_hz,
        count,
        errors,
        spec.density,
        rng,
    )
    renewed_ns = np.rint((first_s + np.arange(count) / rate_hz) * NS_PER_S).astype(np.int64)
    return (values + bias.at(renewed_ns))[shown]
