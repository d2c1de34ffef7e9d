"""Events of something that moves: as if the camera had moved the other way; its points go with it."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import ArrayLike

from asyneio.errors import SimulationError
from asyneio.simulation import EVENT_SCENARIOS, AnalyticMotion, PinholeCamera, PointTruth, Sinusoids
from asyneio.simulation.events import worlds
from asyneio.simulation.events.render import empty_frame, render
from asyneio.simulation.events.schedule import plan_block
from asyneio.simulation.events.source import Seeds, Stage, event_chunks, set_stage
from asyneio.simulation.events.textures import procedural_texture
from asyneio.simulation.events.world import World
from asyneio.simulation.motion import Motion
from asyneio.simulation.rig import C_F_C
from asyneio.types import FloatArray, RecordArray
from tests.simulation.event_worlds import IDEAL, SMALL, STRAIGHT, drifting, small_scenario, stage_of, walls

STILL = drifting((0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Opposite:
    """The motion of a camera that sees a body at rest as a camera at rest sees it move with `body`.

    The resting camera sits at the origin with axes `C_F_C`; poses are the inverse of the body's.
    """

    body: Motion

    def T_w_b(self, t_s: ArrayLike) -> FloatArray:
        still = STILL.T_w_b(np.zeros(1))[0]
        return np.linalg.inv(self.body.T_w_b(t_s)) @ still

    def velocity_w(self, t_s: ArrayLike) -> FloatArray:
        T, omega_w = self.body.T_w_b(t_s), self._omega_w(t_s)
        carried = self.body.velocity_w(t_s) - np.cross(omega_w, T[:, :3, 3])
        return -np.einsum("nji,nj->ni", T[:, :3, :3], carried)

    def acceleration_w(self, t_s: ArrayLike) -> FloatArray:
        raise NotImplementedError

    def angular_velocity_b(self, t_s: ArrayLike) -> FloatArray:
        return -self._omega_w(t_s) @ C_F_C

    def angular_acceleration_b(self, t_s: ArrayLike) -> FloatArray:
        raise NotImplementedError

    def _omega_w(self, t_s: ArrayLike) -> FloatArray:
        return np.einsum("nij,nj->ni", self.body.T_w_b(t_s)[:, :3, :3], self.body.angular_velocity_b(t_s))


def swinging() -> AnalyticMotion:
    """Translation and rotation of some tenths of a metre and radian, around where the world's origin is."""
    amplitude = np.array([[0.1], [0.15], [0.1], [0.1], [0.08], [0.12]])
    frequency_hz = np.array([[1.0], [1.3], [0.9], [1.1], [1.2], [0.8]])
    return AnalyticMotion(Sinusoids(amplitude, frequency_hz, np.linspace(0.0, 2.0, 6)[:, None]))


def with_motion(world: World, body: Motion, first: int = 0) -> World:
    """The rectangles of a world from the first on moving with a body."""
    moving = (np.arange(len(world.corner)) >= first).astype(np.int64)
    return dataclasses.replace(world, motions=(body,), body=moving)


def events_of(stage: Stage) -> RecordArray:
    return np.concatenate(list(event_chunks(stage, np.random.SeedSequence(1))))


def pair(**changes: object) -> tuple[RecordArray, RecordArray]:
    """Events of a moving square before a still camera, and of a still square before a moving camera."""
    scenario = small_scenario(camera=SMALL, sensor=IDEAL, duration_s=0.25, **changes)
    # Two squares, so that one hides the other; nothing behind them that could tell who moves.
    textures = [procedural_texture(128, 128, 1.0, np.random.default_rng(seed)) for seed in (3, 4)]
    world = walls(textures, [2.0, 1.4], [1.6, 0.5])
    moves = stage_of(with_motion(world, swinging()), STILL, scenario)
    still = Stage(moves.scenario, Opposite(swinging()), world, moves.view)
    return events_of(moves), events_of(still)


def by_pixel(events: RecordArray) -> RecordArray:
    return events[np.lexsort((events["t_ns"], events["x"], events["y"]))]


@pytest.mark.slow
def test_a_moving_body_makes_the_events_of_a_camera_that_moves_the_other_way() -> None:
    # With all tiles rendered every millisecond, nothing but rounding can differ.
    moves, still = map(by_pixel, pair(largest_step_px=100.0, longest_step_s=0.001))
    assert moves.size > 15_000
    assert moves.size == still.size
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(moves[name], still[name])
    assert np.abs(moves["t_ns"] - still["t_ns"]).max() <= 1000


def test_its_pace_of_rendering_is_as_fine_as_the_cameras() -> None:
    moves, still = pair(largest_step_px=0.3)
    assert moves.size == pytest.approx(still.size, rel=2e-3)
    counts = [np.bincount(e["y"].astype(int) * SMALL.width + e["x"], minlength=7200) for e in (moves, still)]
    assert np.mean(np.abs(counts[0] - counts[1]) <= 1) > 0.99


def test_no_step_moves_the_image_of_a_body_by_more_than_the_limit() -> None:
    scenario = small_scenario(camera=STRAIGHT)
    grey = [np.full((32, 32), 0.5)] * 2
    world = with_motion(walls(grey, [3.0, 1.2], [16.0, 0.6]), swinging(), first=1)
    stage = stage_of(world, drifting((0.0, 0.2, 0.1)), scenario)
    truth = PointTruth(stage.motion, world, STRAIGHT, np.eye(4), 0)
    rows, columns = np.mgrid[4:72:8, 4:104:8]
    centres = np.column_stack([np.minimum(columns.ravel(), 99), rows.ravel()]).astype(float)
    frame, largest = empty_frame(stage.view), 0.0
    for begin in (0, 96_000, 192_000):
        render(world, stage.view, stage.T_w_c(np.array([begin]))[0], frame, begin * 1e-6)
        span = (begin, begin + 16_000)
        plan = plan_block(stage.motion, np.eye(4), world, stage.view, frame.inverse_depth, span, 0.1, 10_000)
        times = np.concatenate([[begin], plan.t_us])
        for tile, centre in enumerate(centres):
            own = np.unique([*range(0, len(times), plan.stride[tile]), len(times) - 1])
            start = 1000 * times[own[:-1]]
            points, surface, valid = truth.hit(start, np.tile(centre, (start.size, 1)))
            assert valid.all()
            moved, _ = truth.project(1000 * times[own[1:]], points, surface)
            distance = np.hypot(*(moved - centre).T)
            # Where it is to be seen, or may be soon.
            assert distance.max() < 0.1
            largest = max(largest, distance[surface == 1].max(initial=0.0))
    # The body is what sets the pace.
    assert largest > 0.07


def test_points_on_a_body_go_with_it_and_it_hides_what_is_behind() -> None:
    grey = [np.full((32, 32), 0.5)] * 2
    body = drifting((0.0, 0.5, 0.0))
    # `drifting` is a camera's motion: the body's axes are those of the camera it carries.
    body = dataclasses.replace(body, C_f_b=np.eye(3))
    world = with_motion(walls(grey, [2.0, 1.0], [8.0, 0.4]), body, first=1)
    truth = PointTruth(STILL, world, STRAIGHT, np.eye(4), 0)
    second = 1_000_000_000
    centre = np.array([[49.5, 35.5]])
    points, surface, _ = truth.hit([0], centre)
    assert surface[0] == 1
    np.testing.assert_allclose(points, [[1.0, 0.0, 0.0]], atol=1e-12)
    # Half a metre to the left, a metre away.
    uv, visible = truth.project([second], points, surface)
    np.testing.assert_allclose(uv, [[49.5 - 40.0, 35.5]])
    assert visible[0]
    # Where it was, the wall is seen; the wall behind it now is hidden, and was not before.
    assert truth.hit([second], centre)[1][0] == 0
    assert truth.hit([second], uv)[1][0] == 1
    behind = np.array([[2.0, 1.0, 0.0]])
    assert truth.project([0], behind)[1][0]
    assert not truth.project([second], behind)[1][0]
    np.testing.assert_array_equal(
        truth.single_surface([0, second], np.vstack([centre, centre])), [True, True]
    )


@pytest.mark.parametrize("t_ns", [0, 130_000_000, 240_000_000])
def test_a_point_of_a_turning_body_is_where_its_pose_puts_it(t_ns: int) -> None:
    grey = [np.full((32, 32), 0.5)] * 2
    body = swinging()
    motion = drifting((0.1, 0.3, -0.2))
    world = with_motion(walls(grey, [3.0, 1.5], [16.0, 0.8]), body, first=1)
    truth = PointTruth(motion, world, SMALL, np.eye(4), 0)
    uv = np.column_stack([np.linspace(30.0, 65.0, 8), np.linspace(20.0, 50.0, 8)])
    points, surface, _ = truth.hit(np.full(8, t_ns), uv)
    assert (surface == 1).sum() >= 2
    for later in (t_ns, t_ns + 50_000_000):
        T_w_o = np.where((surface == 1)[:, None, None], body.T_w_b([later * 1e-9])[0], np.eye(4))
        points_w = np.einsum("nij,nj->ni", T_w_o, np.column_stack([points, np.ones(8)]))
        points_c = points_w @ np.linalg.inv(motion.T_w_b([later * 1e-9])[0]).T
        expected, _ = PinholeCamera.from_intrinsics(SMALL).project(points_c[:, :3])
        found, _ = truth.project(np.full(8, later), points, surface)
        np.testing.assert_allclose(found, expected, atol=1e-9)
        if later == t_ns:
            np.testing.assert_allclose(found, uv, atol=1e-6)


@pytest.mark.parametrize("name", ["suite_dynamic_6dof", "suite_dynamic_translation"])
def test_twins_differ_in_the_person_alone(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worlds, "procedural_texture", lambda *_: np.ones((1, 1)))
    seeds = Seeds.of(EVENT_SCENARIOS[name].seed)
    walking, standing, nobody = (
        set_stage(EVENT_SCENARIOS[name + twin], seeds) for twin in ("", "_standing", "_nobody")
    )
    t_s = np.linspace(0.0, 30.0, 31)
    count = len(nobody.world.corner)
    assert nobody.world.motions == ()
    for stage in (walking, standing):
        np.testing.assert_array_equal(stage.motion.T_w_b(t_s), nobody.motion.T_w_b(t_s))
        np.testing.assert_array_equal(stage.world.corner[:count], nobody.world.corner)
        assert len(stage.world.corner) == count + 6
    assert np.ptp(standing.world.motions[0].T_w_b(t_s), axis=0).max() == 0.0
    assert np.ptp(walking.world.motions[0].T_w_b(t_s)[:, :3, 3], axis=0).max() > 0.5
    # The person holds a fifth to a third of the picture on average.
    truth = PointTruth(walking.motion, walking.world, walking.scenario.camera, walking.scenario.T_b_c, 0)
    grid = np.stack(np.meshgrid(np.arange(6.0, 240.0, 12.0), np.arange(6.0, 180.0, 12.0)), -1).reshape(-1, 2)
    t_ns = np.linspace(0, 30_000_000_000, 61).astype(np.int64)
    surface = truth.hit(np.repeat(t_ns, len(grid)), np.tile(grid, (t_ns.size, 1)))[1]
    assert 0.15 < np.mean(surface >= count) < 0.35


@pytest.mark.slow
def test_people_are_kept_at_a_distance() -> None:
    with pytest.raises(SimulationError, match=r"the camera comes within 0\.2 m of moving body 1"):
        set_stage(
            small_scenario(person="standing", person_spot_m=(0.2, 0.0, 0.0)),
            Seeds.of(0),
        )
    with pytest.raises(SimulationError, match="person 'dog' is unknown"):
        small_scenario(person="dog")
