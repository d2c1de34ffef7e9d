# SPDX-License-Identifier: Apache-2.0
"""The thread behind the node: a run of the live engine from messages to poses."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from asyneio.errors import AsyneioError
from asyneio.live.engine import run_live
from asyneio.live.options import LiveOptions
from asyneio.live.spool import Spool, check_folder
from asyneio.progress import SilentProgress
from asyneio.ros2.messages import ERROR, STALE, Status, status_of
from asyneio.ros2.output import RosOutput
from asyneio.ros2.parameters import NodeSettings
from asyneio.ros2.poses import RosPose
from asyneio.ros2.source import RosSource

_LOG = logging.getLogger("asyneio.ros2")

#: After this time without a message [s] the state is stale.
_SILENCE_S = 1.0


class OdometryThread:
    """Runs the live engine in a thread of its own, so that callbacks return at once.

    Load shedding, checks of the data, segments and recording are those of `asyneio live`.

    Args:
        settings: of the node.
        publish: called from the thread with every pose.
        report: called from the thread with changes of health and warnings.

    Raises:
        RecordingError: unknown type of event messages, or a folder for the recording that cannot be used.
    """

    def __init__(
        self,
        settings: NodeSettings,
        publish: Callable[[RosPose], None],
        report: Callable[[str], None] = _LOG.info,
    ) -> None:
        self._settings, self._report = settings, report
        self._source = RosSource(settings.events_type, settings.calibration, settings.max_backlog_s)
        self._output = RosOutput(settings.T_base_imu, publish)
        self._spool = _spool_of(settings)
        self._thread = threading.Thread(target=self._work, name="odometry", daemon=True)
        self._stopping = False
        self._failure = ""
        #: Take serialized messages: with events, and sensor_msgs/Imu.
        self.put_events, self.put_imu = self._source.put_events, self._source.put_imu

    def start(self) -> None:
        """Start the thread. Messages are taken once the kernels are loaded."""
        self._thread.start()

    def wait_until_open(self, timeout_s: float | None = None) -> bool:
        """Wait until messages are taken; whether they are."""
        return self._source.opened.wait(timeout_s)

    def stop(self) -> None:
        """Process the messages that have arrived, write the recording, and end the thread."""
        self._stopping = True
        self._source.finish()
        # Before, the kernels are being compiled, which takes minutes and cannot be interrupted.
        if self._source.opened.is_set():
            self._thread.join()

    def counts(self) -> dict[str, int]:
        """Numbers of messages without effect so far, by reason."""
        return self._source.counts()

    def status(self) -> Status:
        """The present state, for diagnostics."""
        step, silence_s = self._output.last, self._source.silence_s()
        if self._failure:
            return Status(ERROR, self._failure, {})
        if step is None and not self._source.opened.is_set():
            return Status(STALE, "starting: kernels are compiled or loaded", {})
        if silence_s > _SILENCE_S:
            return Status(STALE, f"no messages for {silence_s:.1f} s", {})
        if step is None:
            return Status(STALE, "no packet yet: are events and IMU published?", {})
        return status_of(step, self.counts())

    def _work(self) -> None:
        settings, progress = self._settings, _Reported(self._report)
        try:
            summary = run_live(
                self._source,
                settings.config,
                [self._output],
                self._spool,
                LiveOptions(settings.max_backlog_s),
                progress,
            )
            if self._spool is not None:
                self._spool.finish(summary)
            failure = "" if self._stopping else summary.failure
        except AsyneioError as error:
            failure = str(error)
        except Exception as error:  # The node reports it; a thread that ends silently helps no one.
            _LOG.exception("the odometry ended by a defect of asyneio")
            failure = f"the odometry ended by a defect of asyneio: {type(error).__name__}: {error}"
        if failure:
            self._report(failure)
            self._failure = failure


class _Reported(SilentProgress):
    """Messages of a run to a callback."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report

    def message(self, text: str) -> None:
        """See `RunProgress`."""
        self._report(text)


def _spool_of(settings: NodeSettings) -> Spool | None:
    """The folder of the recording, if the parameters name one."""
    if settings.record_folder is None:
        return None
    check_folder(settings.record_folder)
    return Spool(settings.record_folder, settings.config)
