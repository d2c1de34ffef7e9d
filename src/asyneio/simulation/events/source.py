"""The events of a scenario, chunk by chunk: schedule, render, let the pixels respond, sort by time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit

from asyneio.errors import SimulationError
from asyneio.simulation.events.planes import poses_forms_and_lines, rectangles_of
from asyneio.simulation.events.readout import Readout, ReadoutCounts
from asyneio.simulation.events.render import (
    FloatImage,
    TextureArrays,
    empty_frame,
    render,
    render_tile,
    texture_arrays,
)
from asyneio.simulation.events.response import MOST_PER_STEP, Light, respond
from asyneio.simulation.events.scenario import EventScenario, Person
from asyneio.simulation.events.schedule import BLOCK_US, plan_block
from asyneio.simulation.events.sensor import Circuit, EventBuffer, Pixels, make_pixels
from asyneio.simulation.events.view import TILE, View, view_of
from asyneio.simulation.events.world import World
from asyneio.simulation.events.worlds import Walker, build_world
from asyneio.simulation.motion import Motion
from asyneio.simulation.motion_styles import draw_motion
from asyneio.simulation.moving import draw_walk
from asyneio.simulation.pause import PausedMotion
from asyneio.simulation.rig import C_F_C
from asyneio.types import FloatArray, IntArray, RecordArray

_US_PER_S = 1_000_000
_BUFFER = 1 << 15
#: Tiles are shared out over so many threads, so many shares at a time; neither changes any event.
_THREADS = min(4, os.cpu_count() or 1)
_SHARES = 8
#: Spacing of the places that the way of a camera is checked at.
_WAY_US = 10_000
#: The camera stays so far from whatever moves.
_ELBOW_ROOM_M = 0.2


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

    def seen_from(self, t_us: IntArray) -> FloatArray:
        """The same poses (N,B,4,4) in the frame of the world and of each moving body."""
        return self.world.seen_from(np.asarray(t_us * 1e-6), self.T_w_c(t_us))


def set_stage(scenario: EventScenario, seeds: list[np.random.SeedSequence]) -> Stage:
    """Draw motion and world of a scenario from the first two of `seeds`, and from the last the person in it.

    Raises:
        SimulationError: something is unknown, or the camera would leave the free space of the world.
    """
    C_c_b = scenario.T_b_c[:3, :3].T
    motion: Motion
    if scenario.recorded is None:
        rng = np.random.default_rng(seeds[0])
        motion = draw_motion(scenario.motion, rng, C_F_C @ C_c_b, scenario.motion_scale)
    else:
        motion = scenario.recorded.motion
    if scenario.pause_s is not None:
        motion = PausedMotion(motion, *scenario.pause_s)
    world = build_world(
        scenario.world,
        scenario.photographs,
        scenario.sunlit,
        np.random.default_rng(seeds[1]),
        _walker(scenario, np.random.default_rng(seeds[-1])),
        _way_of(scenario, motion),
    )
    stage = Stage(scenario, motion, world, view_of(scenario.camera))
    _check_free(stage)
    return stage


def _walker(scenario: EventScenario, rng: np.random.Generator) -> Walker | None:
    if scenario.person == Person.NOBODY:
        return None
    still = scenario.person == Person.STANDING
    return Walker(draw_walk(rng, scenario.person_spot_m, still), rng)


def _way_of(scenario: EventScenario, motion: Motion) -> FloatArray:
    """Positions (N,3) of the camera along its way, close together [m]."""
    t_us = np.arange(0, round(scenario.duration_s * _US_PER_S) + 1, _WAY_US)
    return (motion.T_w_b(t_us * 1e-6) @ scenario.T_b_c)[:, :3, 3]


def _check_free(stage: Stage) -> None:
    t_us = np.arange(0, round(stage.scenario.duration_s * _US_PER_S) + 1, _WAY_US)
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
    poses = stage.seen_from(t_us)
    for body in range(1, poses.shape[1]):
        corners = stage.world.corners_of(body)
        low, high = corners.min(axis=0) - _ELBOW_ROOM_M, corners.max(axis=0) + _ELBOW_ROOM_M
        inside = ((poses[:, body, :3, 3] > low) & (poses[:, body, :3, 3] < high)).all(axis=1)
        if inside.any():
            raise SimulationError(
                f"the camera comes within {_ELBOW_ROOM_M} m of moving body {body} "
                f"{t_us[inside][0] * 1e-6:.2f} s after the start; expected it to keep away: use "
                "a spot further away or a smaller motion_scale"
            )


def event_chunks(
    stage: Stage, seed: np.random.SeedSequence, counts: ReadoutCounts | None = None
) -> Iterator[RecordArray]:
    """Events (EVENT_DTYPE, camera clock, ascending) of a stage, some milliseconds in each chunk.

    The same stage and seed give the same events. Chunks may be empty. `counts` are added to as events leave
    the sensor or are lost in its readout.
    """
    scenario, sensor = stage.scenario, stage.scenario.sensor
    frame = empty_frame(stage.view)
    render(stage.world, stage.view, stage.T_w_c(np.zeros(1, dtype=np.int64))[0], frame)
    pixels = make_pixels(
        sensor, scenario.camera, frame.intensity, scenario.illumination, np.random.default_rng(seed)
    )
    end_us = round(scenario.duration_s * _US_PER_S)
    readout = Readout(
        sensor, scenario.camera, scenario.start_ns - scenario.timeshift_ns, end_us, counts or ReadoutCounts()
    )
    light = Light(scenario.illumination, 1e-6 * scenario.flicker_hz, scenario.flicker_depth)
    scene = (stage.view.rays, stage.view.pitch, stage.view.tiles)
    textures, circuit = texture_arrays(stage.world), Circuit.of(sensor)
    borders = _shares(len(stage.view.tiles))
    buffers = [EventBuffer.of_size(_BUFFER) for _ in borders]
    now = 0
    with ThreadPoolExecutor(_THREADS) as threads:
        for block_end in [*range(BLOCK_US, end_us, BLOCK_US), end_us]:
            plan = plan_block(
                stage.motion,
                scenario.T_b_c,
                stage.world,
                stage.view,
                frame.inverse_depth,
                (now, block_end),
                scenario.largest_step_px,
                round(scenario.longest_step_s * _US_PER_S),
            )
            planes = poses_forms_and_lines(rectangles_of(stage.world), stage.seen_from(plan.t_us))
            t_us = np.concatenate([[now], plan.t_us]).astype(np.float64)
            work = [
                (share, t_us, plan.stride, planes, scene, textures, light, frame, circuit, pixels, buffer)
                for share, buffer in zip(borders, buffers, strict=True)
            ]
            parts = [part for share in threads.map(_events_of_tiles, work) for part in share]
            yield readout.deliver(parts, block_end)
            now = block_end


def _shares(tiles: int) -> list[tuple[int, int]]:
    """First and last-but-one of the tiles that a thread takes at a time."""
    borders = np.linspace(0, tiles, min(tiles, _SHARES) + 1).astype(int)
    return [(int(first), int(end)) for first, end in pairwise(borders)]


def _events_of_tiles(work: tuple[Any, ...]) -> list[EventBuffer]:
    """All that a share of the tiles reports in a block of time, tile by tile."""
    (tile, end), t_us, stride, planes, scene, textures, light, frame, circuit, pixels, buffer = work
    parts: list[EventBuffer] = []
    step = -1
    while tile < end:
        tile, step, count = _advance(
            (tile, end),
            step,
            t_us,
            stride,
            planes,
            scene,
            textures,
            light,
            frame.intensity,
            frame.inverse_depth,
            circuit,
            pixels,
            buffer,
        )
        parts.append(buffer.between(0, count))
    return parts


@njit(cache=True, error_model="numpy", nogil=True)
def _advance(
    share: tuple[int, int],
    step: int,
    t_us: FloatArray,
    stride: IntArray,
    planes: tuple[FloatArray, FloatArray],
    view: tuple[FloatArray, FloatArray, FloatArray],
    textures: TextureArrays,
    light: Light,
    intensity: FloatImage,
    inverse_depth: FloatArray,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
) -> tuple[int, int, int]:
    """Take one tile after another through a block, rendering and responding at its own pace.

    `share` is the first tile and the one after the last; the first has been taken to `step`. `t_us` (N+1,)
    begins with the start of the block; step -1 is that start. `view` is rays, pitch and tiles. Returns the
    tile and step to resume with when the buffer is full, and the count of events.
    """
    forms, lines = planes
    rays, pitch, tiles = view
    across = (pitch.shape[1] + TILE - 1) // TILE
    steps = t_us.size - 1
    count = 0
    for tile in range(share[0], share[1]):
        before = step if tile == share[0] else -1
        top, left = (tile // across) * TILE, (tile % across) * TILE
        while before < steps - 1:
            if count + TILE * TILE * MOST_PER_STEP > buffer.t_us.size:
                return tile, before, count
            now = min(before + stride[tile], steps - 1)
            inverse_depth[tile] = render_tile(
                tile, forms, lines, now, rays, pitch, tiles, textures, intensity
            )
            count = respond(
                intensity,
                light,
                (top, left),
                TILE,
                (t_us[before + 1], t_us[now + 1]),
                circuit,
                pixels,
                buffer,
                count,
            )
            before = now
    return share[1], -1, count
