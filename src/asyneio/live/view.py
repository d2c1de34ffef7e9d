# SPDX-License-Identifier: Apache-2.0
"""The viewer of a live run, in a thread of its own: when it cannot keep up, it misses steps."""

from __future__ import annotations

import queue
import threading
from pathlib import Path

from asyneio.errors import LiveError
from asyneio.live.chunks import Sensor
from asyneio.live.step import LiveStep
from asyneio.viz.rerun_scene import RerunScene, SceneStep

_MOST_STEPS = 5


class LiveView:
    """Steps in rerun's window, or into a file.

    Args:
        show: open the window.
        file: where the `.rrd` file goes; None: nowhere.
    """

    def __init__(self, show: bool, file: Path | None) -> None:
        self._show, self._file = show, file
        self._steps: queue.Queue[LiveStep | None] = queue.Queue(_MOST_STEPS)
        self._scene: RerunScene | None = None
        self._thread = threading.Thread(target=self._work, name="viewer", daemon=True)
        self.missed = 0

    def begin(self, sensor: Sensor) -> None:
        """See `Output`. Raises LiveError: the viewer could not be started."""
        size = sensor.width, sensor.height
        try:
            self._scene = RerunScene(sensor.name, size, sensor.calibration, self._show, self._file)
        except (RuntimeError, OSError) as error:
            raise LiveError(
                f"rerun's viewer could not be started ({error}): it needs a screen; leave out --view, or use "
                "--record and open view.rrd on another machine (rerun view.rrd)"
            ) from error
        self._thread.start()

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        if step.tracked is None:
            return
        try:
            self._steps.put_nowait(step)
        except queue.Full:
            self.missed += 1

    def end(self) -> None:
        """See `Output`."""
        if self._scene is not None:
            self._steps.put(None)
            self._thread.join()
            self._scene.close()

    def _work(self) -> None:
        assert self._scene is not None
        while (step := self._steps.get()) is not None:
            self._scene.add(scene_step(step))


def scene_step(step: LiveStep) -> SceneStep:
    """What the viewer shows of a step that a packet led to."""
    assert step.tracked is not None
    raw, packet = step.tracked.raw, step.tracked.packet
    figures = {"latency_ms": 1e3 * step.latency_s, "waiting_ms": 1e3 * step.backlog_s}
    return SceneStep(
        step.report,
        step.estimates,
        raw.events,
        packet.observations,
        packet.gyroscope,
        packet.accelerometer,
        step.landmarks,
        figures,
    )
