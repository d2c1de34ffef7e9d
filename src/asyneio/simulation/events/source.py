"""The events of a scenario, chunk by chunk: schedule, render, let the pixels respond, sort by time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from asyneio.errors import SimulationError
from asyneio.simulation.events.render import View, empty_frame, render, view_of
from asyneio.simulation.events.scenario import EventScenario
from asyneio.simulation.events.schedule import BLOCK_US, render_times
from asyneio.simulation.events.sensor import EventBuffer, Pixels, make_pixels, respond
from asyneio.simulation.events.worlds import World, build_world
from asyneio.simulation.motion import Motion
from asyneio.simulation.presets import draw_motion
from asyneio.simulation.rig import C_F_C
from asyneio.types import EVENT_DTYPE, FloatArray, IntArray, RecordArray

_US_PER_S = 1_000_000
_BUFFER = 1 << 16


@dataclass(frozen=True)
class Stage:
    """What stands still during a run, and the way of the camera through it."""

    scenario: EventScenario
    motion: Motion
    world: World
    view: View

    def T_w_c(self, t_us: IntArray) -> FloatArray:
        """Camera poses (N,4,4) at times (N,) [us] since the start."""
        return self.motion.T_w_b(t_us * 1e-6) @ self.scenario.T_b_c


def set_stage(scenario: EventScenario, seeds: list[np.random.SeedSequence]) -> Stage:
    """Draw motion and world of a scenario from the first two of `seeds`.

    Raises:
        SimulationError: something is unknown, or the camera would leave the free space of the world.
    """
    C_f_b = C_F_C @ scenario.T_b_c[:3, :3].T
    motion = draw_motion(scenario.motion, np.random.default_rng(seeds[0]), C_f_b, scenario.motion_scale)
    world = build_world(
        scenario.world, scenario.photographs, scenario.sunlit, np.random.default_rng(seeds[1])
    )
    stage = Stage(scenario, motion, world, view_of(scenario.camera))
    _check_free(stage)
    return stage


def _check_free(stage: Stage) -> None:
    t_us = np.arange(0, round(stage.scenario.duration_s * _US_PER_S) + 1, 10_000)
    way = stage.T_w_c(t_us)[:, :3, 3]
    low, high = stage.world.free_low, stage.world.free_high
    outside = ((way < low) | (way > high)).any(axis=1)
    if outside.any():
        raise SimulationError(
            f"the camera goes from {np.round(way.min(axis=0), 2)} to {np.round(way.max(axis=0), 2)} m and "
            f"leaves the free space of world {stage.scenario.world!r} {t_us[outside][0] * 1e-6:.2f} s after "
            f"the start; expected it within {low} to {high} m: use a larger world, a smaller motion_scale or "
            "a shorter run"
        )


def event_chunks(stage: Stage, seed: np.random.SeedSequence) -> Iterator[RecordArray]:
    """Events (EVENT_DTYPE, camera clock, ascending) of a stage, some milliseconds in each chunk.

    The same stage and seed give the same events. Chunks may be empty.
    """
    scenario = stage.scenario
    frame = empty_frame(stage.view)
    render(stage.world, stage.view, stage.T_w_c(np.zeros(1, dtype=np.int64))[0], frame)
    light = scenario.illumination * frame.intensity
    pixels = make_pixels(scenario.sensor, scenario.camera, light, np.random.default_rng(seed))
    buffer = EventBuffer.of_size(_BUFFER)
    origin_ns = scenario.start_ns - scenario.timeshift_ns
    end_us = round(scenario.duration_s * _US_PER_S)
    now = 0
    for block_end in [*range(BLOCK_US, end_us, BLOCK_US), end_us]:
        times = render_times(
            stage.motion,
            scenario.T_b_c,
            stage.view,
            frame.inverse_depth,
            now,
            block_end,
            scenario.largest_step_px,
            round(scenario.longest_step_s * _US_PER_S),
        )
        chunk = [np.empty(0, dtype=EVENT_DTYPE)]
        for t_us, T_w_c in zip(times, stage.T_w_c(times), strict=True):
            render(stage.world, stage.view, T_w_c, frame)
            light = scenario.illumination * frame.intensity
            chunk.append(_step(scenario, pixels, light.ravel(), (now, int(t_us)), buffer, origin_ns))
            now = int(t_us)
        yield np.concatenate(chunk)


def _step(
    scenario: EventScenario,
    pixels: Pixels,
    light: NDArray[np.float32],
    span: tuple[int, int],
    buffer: EventBuffer,
    origin_ns: int,
) -> RecordArray:
    """Events of all pixels while the light (K,) changes to its new values, in time order."""
    sensor = scenario.sensor
    radians = 2.0 * np.pi * 1e-6
    parts: list[tuple[IntArray, NDArray[np.int32], NDArray[np.uint8]]] = []
    first = 0
    while first < light.size:
        count, first = respond(
            light,
            (float(span[0]), float(span[1])),
            (radians * sensor.bandwidth_hz, radians * sensor.least_bandwidth_hz, sensor.dark_intensity),
            sensor.leak_hz * 1e-6,
            sensor.refractory_s * 1e6,
            (
                pixels.on,
                pixels.off,
                pixels.level,
                pixels.reference,
                pixels.blind_until,
                pixels.next_noise,
                pixels.noise_rate,
            ),
            pixels.hot,
            pixels.random,
            first,
            buffer.t_us,
            buffer.pixel,
            buffer.on,
        )
        parts.append((buffer.t_us[:count].copy(), buffer.pixel[:count].copy(), buffer.on[:count].copy()))
    t_us, pixel, on = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _in_time_order(t_us, pixel, on, span, scenario.camera.width, origin_ns)


@njit(cache=True)
def _order(t_us: IntArray, begin: int, end: int) -> IntArray:
    """Stable order of times within `begin` .. `end`, by counting: a step has few microseconds."""
    starts = np.zeros(end - begin + 2, dtype=np.int64)
    for t in t_us:
        starts[t - begin + 1] += 1
    starts = np.cumsum(starts)
    order = np.empty(t_us.size, dtype=np.int64)
    for index in range(t_us.size):
        slot = t_us[index] - begin
        order[starts[slot]] = index
        starts[slot] += 1
    return order


def _in_time_order(
    t_us: IntArray,
    pixel: NDArray[np.int32],
    on: NDArray[np.uint8],
    span: tuple[int, int],
    width: int,
    origin_ns: int,
) -> RecordArray:
    order = _order(t_us, span[0], span[1])
    events = np.zeros(t_us.size, dtype=EVENT_DTYPE)
    events["t_ns"] = origin_ns + 1000 * t_us[order]
    events["y"], events["x"] = np.divmod(pixel[order], width)
    events["p"] = on[order]
    return events
