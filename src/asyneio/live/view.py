# SPDX-License-Identifier: Apache-2.0
"""The viewer of a live run, in a thread of its own; a slow viewer misses steps."""

from __future__ import annotations

import queue
import threading
from pathlib import Path

from asyneio.errors import LiveError
from asyneio.live.chunks import Sensor
from asyneio.live.step import LiveStep
from asyneio.viz.rerun_scene import RerunScene, SceneStep

#: Largest number of steps that wait for the viewer.
_MOST_STEPS = 5
#: How long [s] the end of a run waits for the viewer.
_LAST_S = 10.0


class LiveView:
    """Steps in the window of rerun, in a file, or both. See `live.step.Output`.

    Args:
        show: open the window.
        file: path of the `.rrd` file; None: no file.
    """

    def __init__(self, show: bool, file: Path | None) -> None:
        self._show, self._file = show, file
        self._steps: queue.Queue[LiveStep | None] = queue.Queue(_MOST_STEPS)
        self._scene: RerunScene | None = None
        self._thread = threading.Thread(target=self._work, name="viewer", daemon=True)
        self._missed = 0
        self._failure = ""

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
        if step.tracked is None or self._failure:
            return
        try:
            self._steps.put_nowait(step)
        except queue.Full:
            self._missed += 1

    def end(self) -> None:
        """See `Output`."""
        if self._scene is None or self._failure:
            return
        try:
            self._steps.put(None, timeout=_LAST_S)
        except queue.Full:
            self._failure = self._failure or "the viewer does not answer"
        self._thread.join(_LAST_S)

    def notes(self) -> tuple[str, ...]:
        """See `Output`."""
        if self._failure:
            return (f"the viewer stopped: {self._failure}",)
        missed = f"the viewer was too slow: it shows all but {self._missed} packet(s)"
        return (missed,) if self._missed else ()

    def _work(self) -> None:
        assert self._scene is not None
        try:
            while (step := self._steps.get()) is not None:
                self._scene.add(scene_step(step))
            self._scene.close()
        except Exception as error:  # An error of rerun does not end the run.
            self._failure = str(error) or type(error).__name__


def scene_step(step: LiveStep) -> SceneStep:
    """The content of a step with a packet, for the viewer."""
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
