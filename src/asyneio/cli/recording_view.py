# SPDX-License-Identifier: Apache-2.0
"""`asyneio run --view`: a run over a recording, shown in the rerun viewer while it proceeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from asyneio.cli import console
from asyneio.errors import RecordingError
from asyneio.pipeline.packets import calibration_of
from asyneio.pipeline.run import Watch
from asyneio.types import EVENT_DTYPE, EventRecording, FloatArray, Packet, RecordArray, Recording, Run
from asyneio.viz.rerun_scene import RerunScene, SceneStep, available

#: Events before the end of a packet that are shown [ns].
_PICTURE_NS = 30_000_000


@contextmanager
def recording_view(recording: Recording | EventRecording, show: bool) -> Iterator[Watch | None]:
    """What to call after each packet of a run; None where nothing is to be shown.

    Raises:
        RecordingError: rerun is not installed, or its viewer could not be started.
    """
    if not show:
        yield None
        return
    if not available():
        raise RecordingError("--view needs the package rerun-sdk: pip install 'asyneio[viz]'")
    calibration = calibration_of(recording)
    camera = calibration.camera
    try:
        scene = RerunScene(recording.name, (camera.width, camera.height), calibration, show=True, file=None)
    except (RuntimeError, OSError) as error:
        raise RecordingError(
            f"rerun's viewer could not be started ({error}): it needs a screen; leave out --view"
        ) from error
    shown = _Shown(scene, recording, calibration.timeshift_ns)
    try:
        yield shown.watch
    finally:
        shown.close()


class _Shown:
    """The packets of a run in the viewer; a viewer that is closed does not end the run."""

    def __init__(self, scene: RerunScene, recording: Recording | EventRecording, timeshift_ns: int) -> None:
        self._scene, self._recording, self._timeshift_ns = scene, recording, timeshift_ns
        self._estimates = 0
        self._open = True

    def watch(self, packet: Packet, landmarks: FloatArray, run: Run) -> None:
        """Show a packet; see `pipeline.run.Watch`."""
        if not self._open:
            return
        estimates = tuple(run.estimates[self._estimates :])
        self._estimates = len(run.estimates)
        events = _newest_events(self._recording, packet.t_end_ns - self._timeshift_ns)
        streams = packet.observations, packet.gyroscope, packet.accelerometer
        self._try(lambda: self._scene.add(SceneStep(run.reports[-1], estimates, events, *streams, landmarks)))

    def close(self) -> None:
        """Send what is held back."""
        if self._open:
            self._try(self._scene.close)

    def _try(self, show: Callable[[], None]) -> None:
        try:
            show()
        except RuntimeError as error:
            self._open = False
            console.say(f"note: {error}: the run continues without it")


def _newest_events(recording: Recording | EventRecording, end_ns: int) -> RecordArray:
    """Events shortly before a time (camera clock); none of a recording of tracks."""
    if isinstance(recording, Recording):
        return np.empty(0, dtype=EVENT_DTYPE)
    a, b = np.searchsorted(recording.events["t_ns"], [end_ns - _PICTURE_NS, end_ns])
    return np.array(recording.events[a:b])
