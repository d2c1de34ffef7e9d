"""A motion with a standstill: still in it, itself before it, and its derivatives are those of its pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asyneio.errors import SimulationError
from asyneio.simulation import SCENARIOS, simulate
from asyneio.simulation.pause import PausedMotion
from tests.simulation.test_motion import derivative, motion_of


def test_still_in_the_pause_and_unchanged_before() -> None:
    motion = motion_of("moderate", 3)
    paused = PausedMotion(motion, 2.0, 5.0)
    still = np.linspace(2.0, 5.0, 40)
    assert np.all(paused.T_w_b(still) == paused.T_w_b(2.0))
    assert not paused.velocity_w(still).any()
    assert not paused.angular_velocity_b(still).any()
    before = np.linspace(0.0, 1.0, 20)
    np.testing.assert_array_equal(paused.T_w_b(before), motion.T_w_b(before))
    # Half a second of its own time is lost in each ramp of one, and the three seconds between.
    np.testing.assert_allclose(paused.T_w_b(8.0), motion.T_w_b(4.0), atol=1e-12)


def test_derivatives_are_those_of_the_pose() -> None:
    paused = PausedMotion(motion_of("aggressive", 1), 2.0, 3.0, 0.8)
    t = np.linspace(0.5, 5.0, 91)
    T = paused.T_w_b(t)
    velocity = derivative(lambda s: paused.T_w_b(s)[:, :3, 3], t)
    spin = np.einsum("nji,njk->nik", T[:, :3, :3], derivative(lambda s: paused.T_w_b(s)[:, :3, :3], t))
    omega = np.column_stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])
    # At the edges of the ramps the fourth derivative jumps.
    np.testing.assert_allclose(paused.velocity_w(t), velocity, atol=1e-7)
    np.testing.assert_allclose(paused.angular_velocity_b(t), omega, atol=1e-7)
    np.testing.assert_allclose(paused.acceleration_w(t), derivative(paused.velocity_w, t), atol=1e-4)
    np.testing.assert_allclose(
        paused.angular_acceleration_b(t), derivative(paused.angular_velocity_b, t), atol=1e-3
    )


@pytest.mark.slow
def test_scenario_with_a_pause_and_one_on_the_spot() -> None:
    scenario = replace(SCENARIOS["moderate"], duration_s=3.0)
    paused = simulate(replace(scenario, pause_s=(1.0, 2.0))).truth
    at = scenario.start_ns + np.array([1_100_000_000, 1_900_000_000])
    assert np.all(paused.at(at).T_w_b[0] == paused.at(at).T_w_b[1])
    turning = simulate(replace(scenario, motion_scale=0.0)).truth.at(at)
    assert not turning.T_w_b[:, :3, 3].any()
    assert np.linalg.norm(turning.angular_velocity_b) > 0.1


@pytest.mark.parametrize(("begin_s", "end_s"), [(0.5, 3.0), (3.0, 2.0)])
def test_impossible_pauses(begin_s: float, end_s: float) -> None:
    with pytest.raises(SimulationError, match="expected 0 < ramp <= begin <= end"):
        PausedMotion(motion_of("gentle", 0), begin_s, end_s)
