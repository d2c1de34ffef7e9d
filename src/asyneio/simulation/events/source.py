# SPDX-License-Identifier: Apache-2.0
"""Events of a scenario, in chunks: schedule, render, respond, read out."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from asyneio.errors import SimulationError
from asyneio.jit import njit
from asyneio.simulation.events.planes import Planes, planes_of, rectangles_of
from asyneio.simulation.events.pyramid import Pyramids
from asyneio.simulation.events.readout import Readout, ReadoutCounts
from asyneio.simulation.events.render import Frame, empty_frame, render, render_tile
from asyneio.simulation.events.response import MAX_EVENTS_PER_STEP, Light, Span, Square, respond
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
#: Number of threads, and of ranges of tiles distributed over them; neither affects the events.
_THREADS = min(4, os.cpu_count() or 1)
_RANGES = 8
#: Spacing of the camera positions that are checked for free space.
_PATH_STEP_US = 10_000
#: Minimum distance of the camera to moving bodies.
_CLEARANCE_M = 0.2


class Seeds(NamedTuple):
    """Random seeds of a run, one for each random part of it."""

    motion: np.random.SeedSequence
    world: np.random.SeedSequence
    sensor: np.random.SeedSequence
    gyroscope: np.random.SeedSequence
    accelerometer: np.random.SeedSequence
    person: np.random.SeedSequence

    @classmethod
    def of(cls, seed: int) -> Seeds:
        """The seeds of a scenario's seed."""
        return cls(*np.random.SeedSequence(seed).spawn(6))


@dataclass(frozen=True)
class Stage:
    """Motion, world and camera of a run."""

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


def set_stage(scenario: EventScenario, seeds: Seeds) -> Stage:
    """Draw motion, world and person of a scenario.

    Raises:
        SimulationError: a name is unknown, or the camera would leave the free space of the world.
    """
    C_c_b = scenario.T_b_c[:3, :3].T
    motion: Motion
    if scenario.recorded is None:
        rng = np.random.default_rng(seeds.motion)
        motion = draw_motion(scenario.motion, rng, C_F_C @ C_c_b, scenario.motion_scale)
    else:
        motion = scenario.recorded.motion
    if scenario.pause_s is not None:
        motion = PausedMotion(motion, *scenario.pause_s)
    world = build_world(
        scenario.world,
        scenario.photographs,
        scenario.sunlit,
        np.random.default_rng(seeds.world),
        _walker(scenario, np.random.default_rng(seeds.person)),
        _path_of(scenario, motion),
    )
    stage = Stage(scenario, motion, world, view_of(scenario.camera))
    _check_free(stage)
    return stage


def _walker(scenario: EventScenario, rng: np.random.Generator) -> Walker | None:
    if scenario.person == Person.NOBODY:
        return None
    still = scenario.person == Person.STANDING
    return Walker(draw_walk(rng, scenario.person_spot_m, still), rng)


def _path_of(scenario: EventScenario, motion: Motion) -> FloatArray:
    """Closely spaced positions (N,3) of the camera [m]."""
    t_us = np.arange(0, round(scenario.duration_s * _US_PER_S) + 1, _PATH_STEP_US)
    return (motion.T_w_b(t_us * 1e-6) @ scenario.T_b_c)[:, :3, 3]


def _check_free(stage: Stage) -> None:
    t_us = np.arange(0, round(stage.scenario.duration_s * _US_PER_S) + 1, _PATH_STEP_US)
    path = stage.T_w_c(t_us)[:, :3, 3]
    low, high = stage.world.free_low, stage.world.free_high
    outside = ((path < low) | (path > high)).any(axis=1)
    if outside.any():
        raise SimulationError(
            f"the camera moves from {np.round(path.min(axis=0), 2)} to {np.round(path.max(axis=0), 2)} m and "
            f"leaves the free space of world {stage.scenario.world!r} {t_us[outside][0] * 1e-6:.2f} s after "
            f"the start; expected it within {low} to {high} m: use a larger world, a smaller motion_scale or "
            "a shorter run"
        )
    poses = stage.seen_from(t_us)
    for body in range(1, poses.shape[1]):
        corners = stage.world.corners_of(body)
        low, high = corners.min(axis=0) - _CLEARANCE_M, corners.max(axis=0) + _CLEARANCE_M
        inside = ((poses[:, body, :3, 3] > low) & (poses[:, body, :3, 3] < high)).all(axis=1)
        if inside.any():
            raise SimulationError(
                f"the camera comes within {_CLEARANCE_M} m of moving body {body} "
                f"{t_us[inside][0] * 1e-6:.2f} s after the start; expected a larger distance: use "
                "a more distant person_spot_m or a smaller motion_scale"
            )


def event_chunks(
    stage: Stage, seed: np.random.SeedSequence, counts: ReadoutCounts | None = None
) -> Iterator[RecordArray]:
    """Events (EVENT_DTYPE, camera clock, ascending) of a stage, in chunks of some milliseconds.

    The same stage and seed give the same events. Chunks may be empty.

    Args:
        stage: motion, world and camera.
        seed: seed of the sensor.
        counts: updated as events leave the sensor or are lost in its readout.
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
    scene = Scene(stage.view, stage.world.pyramids, light)
    circuit = Circuit.of(sensor)
    ranges = _tile_ranges(len(stage.view.tiles))
    buffers = [EventBuffer.of_size(_BUFFER) for _ in ranges]
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
            t_us = np.concatenate([[now], plan.t_us]).astype(np.float64)
            planes = planes_of(rectangles_of(stage.world), stage.seen_from(plan.t_us))
            block = Block(t_us, plan.stride, planes)

            def events_of(
                work: tuple[tuple[int, int], EventBuffer], block: Block = block
            ) -> list[EventBuffer]:
                """Events of a range of tiles in this block; runs in a thread."""
                tiles, buffer = work
                return _events_of_tiles(tiles, block, scene, frame, circuit, pixels, buffer)

            work = zip(ranges, buffers, strict=True)
            parts = [part for of_range in threads.map(events_of, work) for part in of_range]
            yield readout.deliver(parts, block_end)
            now = block_end


class Scene(NamedTuple):
    """What is constant during a run, as kernels take it: rays of the camera, textures and light."""

    camera: View
    textures: Pyramids
    light: Light


class Block(NamedTuple):
    """A block of time, as kernels take it.

    Attributes:
        t_us: (N+1,) start of the block and the N times of rendering [us].
        stride: (J,) a tile is rendered at every stride-th of these times and at the last.
        planes: rectangles as seen at the N times.
    """

    t_us: FloatArray
    stride: IntArray
    planes: Planes


def _tile_ranges(tiles: int) -> list[tuple[int, int]]:
    """Ranges of tiles, first and end, that a thread processes at a time."""
    borders = np.linspace(0, tiles, min(tiles, _RANGES) + 1).astype(int)
    return [(int(first), int(end)) for first, end in pairwise(borders)]


def _events_of_tiles(
    tiles: tuple[int, int],
    block: Block,
    scene: Scene,
    frame: Frame,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
) -> list[EventBuffer]:
    """Events of a range of tiles in a block of time, tile by tile."""
    tile, end = tiles
    parts: list[EventBuffer] = []
    step = -1
    while tile < end:
        tile, step, count = _advance((tile, end), step, block, scene, frame, circuit, pixels, buffer)
        parts.append(buffer.between(0, count))
    return parts


@njit(cache=True, error_model="numpy", nogil=True)
def _advance(
    tiles: tuple[int, int],
    step: int,
    block: Block,
    scene: Scene,
    frame: Frame,
    circuit: Circuit,
    pixels: Pixels,
    buffer: EventBuffer,
) -> tuple[int, int, int]:
    """Advance a range of tiles through a block, rendering each at its own stride, until the buffer is full.

    Args:
        tiles: first and end of the range.
        step: step that the first tile has reached; -1 is the start of the block.
        block: times of rendering, and rectangles as seen then.
        scene: camera, textures and light.
        frame: rendered image.
        circuit: parameters of all pixels.
        pixels: state of all pixels.
        buffer: output.

    Returns:
        Tile and step to resume from, and the number of events in the buffer.
    """
    t_us, planes, view = block.t_us, block.planes, scene.camera
    across = (view.pitch.shape[1] + TILE - 1) // TILE
    steps = t_us.size - 1
    count = 0
    for tile in range(tiles[0], tiles[1]):
        before = step if tile == tiles[0] else -1
        square = Square((tile // across) * TILE, (tile % across) * TILE, TILE)
        while before < steps - 1:
            if count + TILE * TILE * MAX_EVENTS_PER_STEP > buffer.t_us.size:
                return tile, before, count
            now = min(before + block.stride[tile], steps - 1)
            render_tile(tile, now, planes, view, scene.textures, frame)
            span = Span(t_us[before + 1], t_us[now + 1])
            count = respond(frame.intensity, scene.light, square, span, circuit, pixels, buffer, count)
            before = now
    return tiles[1], -1, count
