"""The rig that every simulation carries: its calibration, and its IMU with the truth behind it."""

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
from asyneio.simulation.motion import Motion
from asyneio.simulation.scenario import RigScenario
from asyneio.simulation.truth import Truth
from asyneio.types import NS_PER_S, Calibration, FloatArray, IntArray, RecordArray

#: Camera axes (x right, y down, z forward) in the carrier (x forward, y left, z up), one a column.
C_F_C = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class InertialRun:
    """Both streams (INERTIAL_DTYPE, IMU clock) and the truth of the run."""

    gyroscope: RecordArray
    accelerometer: RecordArray
    truth: Truth


def simulate_inertial(
    scenario: RigScenario,
    motion: Motion,
    for_gyroscope: np.random.Generator,
    for_accelerometer: np.random.Generator,
) -> InertialRun:
    """What the IMU of a scenario reads on its way, each sensor with randomness of its own."""
    t_ns = sample_times(scenario.gyroscope, scenario.duration_s)
    ideal = motion.angular_velocity_b(t_ns / NS_PER_S)
    gyroscope, bias_gyroscope = _stream(scenario, scenario.gyroscope, t_ns, ideal, for_gyroscope)
    t_ns = sample_times(scenario.accelerometer, scenario.duration_s)
    ideal = specific_force_b(motion, t_ns / NS_PER_S, scenario.gravity)
    accelerometer, bias_accelerometer = _stream(
        scenario, scenario.accelerometer, t_ns, ideal, for_accelerometer
    )
    end_ns = scenario.start_ns + round(scenario.duration_s * NS_PER_S)
    truth = Truth(scenario.start_ns, end_ns, motion, bias_gyroscope, bias_accelerometer)
    return InertialRun(gyroscope, accelerometer, truth)


def calibration_of(scenario: RigScenario) -> Calibration:
    """The true calibration of a scenario."""
    noise = scenario.noise
    if scenario.gyroscope_rate_hz == scenario.accelerometer_rate_hz:
        # Only then is there one rate to declare.
        noise = replace(noise, rate_hz=scenario.gyroscope_rate_hz)
    return Calibration(scenario.camera, scenario.T_b_c, scenario.timeshift_ns, noise)


def _stream(
    scenario: RigScenario, spec: StreamSpec, t_ns: IntArray, ideal: FloatArray, rng: np.random.Generator
) -> tuple[RecordArray, BiasWalk]:
    bias = draw_bias(spec, t_ns, rng)
    return as_records(scenario.start_ns + t_ns, corrupt(ideal, t_ns, bias, spec, rng)), bias
