"""Events: they add up to the change of the light, at the right time and place, with the sensor's faults."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import SimulationError
from asyneio.simulation import (
    EVENT_SCENARIOS,
    EventSimulation,
    MotionStyle,
    SensorSpec,
    WorldKind,
    simulate_events,
    stream_events,
)
from asyneio.simulation.events import worlds
from asyneio.simulation.events.render import empty_frame, render
from asyneio.simulation.events.scenario import SUITE
from asyneio.simulation.events.sensor import make_pixels
from asyneio.simulation.events.source import Seeds, Stage, event_chunks, set_stage
from asyneio.simulation.events.textures import procedural_texture
from asyneio.simulation.events.worlds import build_world
from asyneio.types import EVENT_DTYPE, RecordArray
from tests.simulation.event_worlds import IDEAL, SMALL, STRAIGHT, drifting, small_scenario, stage_of, walls

SCENARIO = small_scenario(motion="moderate")


SEEDS = Seeds.of(0)


@pytest.fixture(scope="module")
def stage() -> Stage:
    return set_stage(SCENARIO, SEEDS)


def events_of(stage: Stage, **changes: object) -> RecordArray:
    """Events of another scenario in the same world."""
    changed = dataclasses.replace(stage, scenario=dataclasses.replace(stage.scenario, **changes))
    return np.concatenate(list(event_chunks(changed, SEEDS.sensor)))


@pytest.fixture(scope="module")
def run() -> EventSimulation:
    return simulate_events(SCENARIO)


def per_pixel(events: RecordArray, polarity: int) -> np.ndarray:
    chosen = events[events["p"] == polarity]
    return np.bincount(
        chosen["y"].astype(int) * SMALL.width + chosen["x"], minlength=SMALL.width * SMALL.height
    )


def intervals_ns(events: RecordArray) -> np.ndarray:
    """Times between two events of the same pixel."""
    pixel = events["y"].astype(int) * SMALL.width + events["x"]
    order = np.lexsort((events["t_ns"], pixel))
    same = np.diff(pixel[order]) == 0
    return np.diff(events["t_ns"][order])[same]


@pytest.mark.slow
def test_the_recording_is_what_a_reader_delivers(run: EventSimulation) -> None:
    recording = run.recording
    events, start = recording.events, SCENARIO.start_ns
    assert events.dtype == EVENT_DTYPE
    assert events.size > 1000
    assert np.all(np.diff(events["t_ns"]) >= 0)
    assert np.all(events["t_ns"] % 1000 == start % 1000)
    assert events["t_ns"][0] >= start - SCENARIO.timeshift_ns
    assert events["t_ns"][-1] <= start - SCENARIO.timeshift_ns + round(SCENARIO.duration_s * 1e9)
    assert events["x"].max() < recording.width == SMALL.width
    assert events["y"].max() < recording.height == SMALL.height
    assert recording.gyroscope["t_ns"][0] == recording.accelerometer["t_ns"][0] == start
    assert recording.gyroscope.size == recording.accelerometer.size == 301
    assert recording.calibration is not None
    assert recording.calibration.noise.rate_hz == 1000.0
    assert recording.ground_truth is not None


@pytest.mark.slow
def test_the_same_scenario_gives_the_same_events_also_in_pieces(run: EventSimulation) -> None:
    streamed = np.concatenate(list(stream_events(SCENARIO)))
    np.testing.assert_array_equal(streamed, run.recording.events)
    given = simulate_events(SCENARIO, streamed)
    assert given.recording.events is streamed
    np.testing.assert_array_equal(given.recording.gyroscope, run.recording.gyroscope)
    other = next(chunk for chunk in stream_events(dataclasses.replace(SCENARIO, seed=1)) if chunk.size)
    assert not np.array_equal(other, streamed[: other.size])


@pytest.mark.slow
def test_events_add_up_to_the_change_of_the_light(stage: Stage) -> None:
    events = events_of(stage, sensor=IDEAL)
    frame, logs = empty_frame(stage.view), []
    for t_us in (0, round(SCENARIO.duration_s * 1e6)):
        render(stage.world, stage.view, stage.T_w_c(np.array([t_us]))[0], frame)
        logs.append(np.log(frame.intensity.ravel() + IDEAL.dark_intensity))
    pixels = make_pixels(IDEAL, SMALL, frame.intensity, 1.0, np.random.default_rng(SEEDS.sensor))
    answered = pixels.on * per_pixel(events, 1) - pixels.off * per_pixel(events, 0)
    left = logs[1] - logs[0] - answered
    assert np.all(left < pixels.on + 1e-4)
    assert np.all(left > -pixels.off - 1e-4)
    # Not for want of change.
    assert np.abs(logs[1] - logs[0]).max() > 4.0 * IDEAL.threshold_on


def test_thresholds_have_the_given_mismatch() -> None:
    spec = SensorSpec(threshold_mismatch=0.04)
    pixels = make_pixels(spec, SMALL, np.ones((72, 100), np.float32), 1.0, np.random.default_rng(0))
    for values, mean in ((pixels.on, spec.threshold_on), (pixels.off, spec.threshold_off)):
        assert values.mean() == pytest.approx(mean, rel=2e-3)
        assert values.std() == pytest.approx(0.04 * mean, rel=0.05)
    assert abs(np.corrcoef(pixels.on, pixels.off)[0, 1]) < 0.05


@pytest.mark.slow
def test_a_pixel_is_blind_for_the_refractory_time(stage: Stage, run: EventSimulation) -> None:
    assert intervals_ns(run.recording.events).min() >= 1_500_000
    unlimited = events_of(stage, sensor=dataclasses.replace(SCENARIO.sensor, refractory_s=0.0))
    assert intervals_ns(unlimited).min() < 1_500_000
    assert unlimited.size > run.recording.events.size


@pytest.mark.slow
def test_a_static_scene_gives_only_noise_at_the_given_rate(stage: Stage) -> None:
    spec = dataclasses.replace(IDEAL, shot_noise_hz=4.0, leak_hz=1.0, hot_pixels=3, hot_pixel_hz=200.0)
    still = dataclasses.replace(stage, motion=drifting((0.0, 0.0, 0.0)))
    events = events_of(still, sensor=spec, illumination=1e-5, duration_s=1.9)
    counts = per_pixel(events, 0) + per_pixel(events, 1)
    hot = np.argsort(counts)[-3:]
    assert counts[hot] / 1.9 == pytest.approx(200.0, rel=0.2)
    off = np.delete(per_pixel(events, 0), hot).mean() / 1.9
    assert off == pytest.approx(2.0, rel=0.05)
    # Leakage makes events of the brighter kind only; noise that strikes first resets it.
    assert 2.0 < np.delete(per_pixel(events, 1), hot).mean() / 1.9 < 3.0
    light = events_of(still, sensor=spec, illumination=1.0, duration_s=1.9)
    assert light.size < events.size


@pytest.mark.slow
def test_slow_photoreceptors_answer_late_and_less(stage: Stage) -> None:
    quick = events_of(stage, sensor=IDEAL)
    spec = dataclasses.replace(IDEAL, bandwidth_hz=20.0, least_bandwidth_hz=5.0)
    slow = events_of(stage, sensor=spec)
    assert 0 < slow.size < 0.8 * quick.size
    assert slow["t_ns"][0] > quick["t_ns"][0]


def test_events_move_with_the_flow(rng: np.random.Generator) -> None:
    """Along a wall two metres away at 1 m/s, the image moves by f v / z = 40 px/s: sharpest when undone."""
    world = walls([procedural_texture(256, 256, 1.0, rng)], [2.0], [8.0])
    scenario = small_scenario(camera=STRAIGHT, sensor=IDEAL, duration_s=0.25)
    events = events_of(stage_of(world, drifting((0.0, 1.0, 0.0)), scenario))
    t_s = (events["t_ns"] - events["t_ns"][0]) * 1e-9
    sign = np.where(events["p"] == 1, 0.25, -0.22)

    def contrast(speed: float) -> float:
        column = np.rint(events["x"] - speed * t_s).astype(int)
        inside = (column >= 0) & (column < STRAIGHT.width)
        image = np.zeros((STRAIGHT.height, STRAIGHT.width))
        np.add.at(image, (events["y"][inside], column[inside]), sign[inside])
        return float(image.var())

    # The camera moves to its left, the image to the right.
    speeds = np.arange(20.0, 61.0, 2.0)
    assert speeds[np.argmax([contrast(v) for v in speeds])] == pytest.approx(40.0, abs=2.0)


@pytest.mark.parametrize("kind", list(WorldKind))
def test_a_world_keeps_its_free_space_free(kind: WorldKind, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worlds, "procedural_texture", lambda *_: np.ones((1, 1)))
    world = build_world(kind, False, 1.0, np.random.default_rng(0))
    # Perpendicular edges; no rectangle reaches into the free box.
    np.testing.assert_allclose(np.sum(world.edge_u * world.edge_v, axis=1), 0.0, atol=1e-9)
    for s in np.linspace(0.0, 1.0, 13):
        for t in np.linspace(0.0, 1.0, 13):
            point = world.corner + s * world.edge_u + t * world.edge_v
            assert not np.any(np.all((point > world.free_low) & (point < world.free_high), axis=1))


@pytest.mark.slow
@pytest.mark.parametrize("name", EVENT_SCENARIOS)
def test_no_ready_scenario_leaves_the_free_space(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # Plain surfaces: textures take long to draw and do not matter here.
    monkeypatch.setattr(worlds, "procedural_texture", lambda *_: np.ones((1, 1)))
    for seed in range(3):
        set_stage(EVENT_SCENARIOS[name], Seeds.of(seed))


def test_the_suite_shares_rig_and_length_but_no_motion() -> None:
    assert len(SUITE) == 9
    assert len({scenario.seed for scenario in SUITE}) == 9
    for scenario in SUITE:
        assert EVENT_SCENARIOS[scenario.name] is scenario
        assert scenario.duration_s == 30.0
        assert scenario.gyroscope_rate_hz == scenario.accelerometer_rate_hz == 1000.0
        # 0.005 deg/s and 400 ug per root hertz.
        assert scenario.noise.gyroscope_density == pytest.approx(np.deg2rad(0.005), rel=0.01)
        assert scenario.noise.accelerometer_density == pytest.approx(400e-6 * 9.80665, rel=0.01)
    assert [scenario.person for scenario in SUITE].count("walking") == 2


@pytest.mark.slow
def test_what_is_impossible_is_refused() -> None:
    with pytest.raises(SimulationError, match="leaves the free space of world 'near'"):
        next(stream_events(small_scenario(motion=MotionStyle.MODERATE, motion_scale=2.0, duration_s=20.0)))
    with pytest.raises(SimulationError, match="world 'moon' is unknown"):
        next(stream_events(small_scenario(world="moon")))
    with pytest.raises(SimulationError, match="thresholds"):
        SensorSpec(threshold_on=0.0)
    with pytest.raises(SimulationError, match=r"threshold_noise = 0\.1"):
        SensorSpec(threshold_noise=0.1)
    with pytest.raises(SimulationError, match="cannot be simulated"):
        SensorSpec(latency_s=-1e-6)
    with pytest.raises(SimulationError, match=r"flicker_depth = 1\.5"):
        small_scenario(flicker_depth=1.5)
    with pytest.raises(SimulationError, match="illumination = 0"):
        small_scenario(illumination=0.0)


@pytest.mark.slow
def test_photographs_are_rendered(monkeypatch: pytest.MonkeyPatch, data_dir: Path) -> None:
    monkeypatch.setenv("ASYNEIO_DATA", str(data_dir))
    drawn, photographed = (
        np.concatenate(list(stream_events(small_scenario(photographs=photographs))))
        for photographs in (False, True)
    )
    # Brick, grass and gravel: texture everywhere, so events everywhere, unlike the drawn scenes.
    assert photographed.size > drawn.size
    tiles = np.unique(photographed["y"].astype(int) // 8 * 100 + photographed["x"] // 8)
    assert tiles.size > 0.95 * (SMALL.width // 8) * (SMALL.height // 8)


def test_photographs_are_asked_for_and_missed(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    monkeypatch.setenv("ASYNEIO_DATA", str(tmp_path))
    with pytest.raises(SimulationError, match="contains no PNG file"):
        next(stream_events(small_scenario(photographs=True)))
