# SPDX-License-Identifier: Apache-2.0
"""The live run: source, front end and estimator, each in a thread, and all outputs."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from asyneio.config import Config
from asyneio.errors import AsyneioError
from asyneio.live.chunks import Sensor, Source
from asyneio.live.gravity import GravityCheck
from asyneio.live.inbox import Inbox
from asyneio.live.intake import IntakeThread
from asyneio.live.interrupts import ending_softly
from asyneio.live.options import LiveOptions
from asyneio.live.scale import ScaleCheck
from asyneio.live.spool import Spool
from asyneio.live.step import LiveStep, Output
from asyneio.live.summary import LiveSummary, Tally
from asyneio.live.tracking import Keep, StretchEnd, Tracked, TrackingThread
from asyneio.odometry import Odometry
from asyneio.pipeline.compilation import compile_ahead, watch_compilation
from asyneio.pipeline.kernels import (
    compile_frontend,
    compile_intervals,
    compile_linearization,
    compile_start,
    compile_visual,
)
from asyneio.progress import SILENT, RunProgress
from asyneio.types import Estimate, Health, Packet, StepReport

#: A source that is silent for this time [s] is reported as DEGRADED, and again at this interval.
_SILENCE_S = 0.5
#: How long [s] a source is waited for at the end.
_DRIVER_S = 2.0


class LiveInterrupted(KeyboardInterrupt):
    """A live run was ended by Ctrl-C or SIGTERM; `summary` has the figures, and all files are written."""

    def __init__(self, summary: LiveSummary) -> None:
        super().__init__("interrupted")
        self.summary = summary


def run_live(
    source: Source,
    config: Config,
    outputs: Sequence[Output] = (),
    spool: Spool | None = None,
    options: LiveOptions | None = None,
    progress: RunProgress = SILENT,
) -> LiveSummary:
    """Estimate poses from a source until it ends.

    While no load is shed and the source does not jump in time, the estimates are those of `run_recording` on
    the same data. Where the stream breaks, a new stretch with a new segment begins.

    Args:
        source: not yet open; it is closed at the end.
        config: all settings.
        outputs: receive every step.
        spool: keeps the raw stream and the results.
        options: how time is treated.
        progress: receives messages on compilation and changes of health.

    Raises:
        LiveError, CalibrationError: the source cannot be opened, or its sensor has no calibration.
        LiveInterrupted: Ctrl-C or SIGTERM; data that had arrived are processed and written.
        AsyneioError: an output cannot begin; see its class.
    """
    options = options or LiveOptions()
    stop = threading.Event()
    try:
        # Errors of a file are reported at once. A camera would fill the queues during compilation.
        sensor = source.open(stop) if source.starts_when_read else None
        with watch_compilation(progress) as compilation:
            compile_ahead(compilation, progress)
            load_kernels()
        sensor = sensor or source.open(stop)
        return _Engine(source, sensor, config, outputs, spool, options, progress).run()
    finally:
        stop.set()
        source.close()


def load_kernels() -> None:
    """Load all compiled kernels, which otherwise happens during the first packets and delays them."""
    for load in (compile_frontend, compile_visual, compile_intervals, compile_start, compile_linearization):
        load()


class _Engine:
    def __init__(
        self,
        source: Source,
        sensor: Sensor,
        config: Config,
        outputs: Sequence[Output],
        spool: Spool | None,
        options: LiveOptions,
        progress: RunProgress,
    ) -> None:
        self._config, self._sensor, self._options, self._progress = config, sensor, options, progress
        self._outputs: list[Output] = [*outputs, *([spool] if spool else [])]
        inbox = Inbox(source.can_wait)
        max_backlog_s = None if source.can_wait else options.max_backlog_s
        self._source = source
        self._intake = IntakeThread(source, sensor, inbox, options.duration_s)
        keep: Keep | None = spool.keep if spool else None
        self._tracking = TrackingThread(inbox, sensor, config, keep, max_backlog_s)
        self._estimator = Odometry(config, sensor.calibration)
        self._first_segment = 0
        self._last: StepReport | None = None
        self._reported_silence_s = 0.0
        self._ending_since_s: float | None = None
        self._reported_ending = False
        self._tally = Tally(sensor.name)
        self._gravity = GravityCheck()
        self._scale = ScaleCheck(config, sensor.calibration)

    def run(self) -> LiveSummary:
        self._begin()
        error = ""
        with ending_softly(self._end) as interrupts:
            try:
                self._work()
            except AsyneioError as caught:
                error = str(caught)
            except KeyboardInterrupt:
                error = "ended at once by a second interrupt"
            finally:
                self._intake.stop()
                self._tracking.abort()
                self._intake.join(timeout_s=_DRIVER_S)
                for output in self._outputs:
                    output.end()
            contradiction, notes = self._scale.result(self._estimator.calibration())
            notes = (*self._notes(), *notes)
            summary = self._tally.summary(error, contradiction, notes, self._tracking.busy_s)
        if interrupts.count:
            raise LiveInterrupted(summary)
        return summary

    def _begin(self) -> None:
        """Start outputs and threads; where one output cannot start, end those that have."""
        started: list[Output] = []
        try:
            for output in self._outputs:
                output.begin(self._sensor)
                started.append(output)
        except BaseException:
            for output in started:
                output.end()
            raise
        self._tracking.start()
        self._intake.start()

    def _end(self) -> None:
        """Called by a signal handler, which may have interrupted output: nothing is printed here."""
        self._ending_since_s = time.perf_counter()
        self._intake.stop()

    def _work(self) -> None:
        while True:
            self._check_ending()
            try:
                item = self._tracking.queue.get(timeout=0.1)
            except queue.Empty:
                self._check_silence()
                continue
            if isinstance(item, BaseException):
                raise item
            if isinstance(item, StretchEnd):
                if not item.reason:
                    break
                self._end_stretch(item)
            else:
                self._step(item)
        if self._intake.failure is not None:
            raise self._intake.failure

    def _check_ending(self) -> None:
        """After an interrupt, report it, and do not wait for a driver that does not return."""
        since_s = self._ending_since_s
        if since_s is None:
            return
        if not self._reported_ending:
            self._reported_ending = True
            self._progress.message("ending: processing what has arrived (Ctrl-C again: at once)")
        if time.perf_counter() - since_s > _DRIVER_S:
            self._intake.abandon()

    def _step(self, tracked: Tracked) -> None:
        estimates, report = self._process(tracked.packet)
        tracked.feedback(report.outlier_share)
        if self._gravity.add(tracked.packet):
            self._progress.message(
                f"warning: {self._gravity.complaint}; the positions will be wrong by metres"
            )
        if self._scale.add(tracked.packet) and self._scale.check(self._estimator.calibration()):
            self._progress.message(f"warning: {self._scale.complaint}")
        now_s = time.perf_counter()
        self._reported_silence_s = 0.0
        self._publish(
            LiveStep(
                report,
                tuple(estimates),
                now_s - tracked.raw.knot_s,
                now_s - tracked.raw.complete_s,
                tracked.backlog_s,
                tracked.shed,
                tracked,
                self._estimator.landmarks() if self._options.landmarks else None,
            )
        )

    def _process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Estimates and report of a packet, with segments counted over all stretches."""
        started = time.perf_counter()
        estimates, report = self._estimator.process(packet)
        segment = report.segment + self._first_segment
        report = replace(report, segment=segment, seconds=time.perf_counter() - started)
        first = self._first_segment
        return [replace(estimate, segment=estimate.segment + first) for estimate in estimates], report

    def _end_stretch(self, end: StretchEnd) -> None:
        """Restart the estimator; a segment that was initialized is lost."""
        last = self._last
        self._estimator = Odometry(self._config, self._sensor.calibration)
        self._scale.restart()
        if last is None:
            return
        posed = last.health in (Health.TRACKING, Health.DEGRADED)
        health = Health.LOST if posed else Health.INITIALIZING
        self._publish(
            LiveStep(StepReport(last.t_ns, health, end.reason, segment=last.segment), shed=self._tally.shed)
        )
        self._first_segment = self._tally.segments

    def _check_silence(self) -> None:
        """Report a source that is silent, while the estimator waits for it."""
        silence_s = self._intake.silence_s()
        last = self._last
        if last is None or silence_s < self._reported_silence_s + _SILENCE_S or last.health is Health.LOST:
            return
        self._reported_silence_s = silence_s
        health = Health.INITIALIZING if last.health is Health.INITIALIZING else Health.DEGRADED
        reason = f"no data from the source for {silence_s:.1f} s"
        report = StepReport(last.t_ns, health, reason, segment=last.segment)
        self._publish(LiveStep(report, shed=self._tally.shed))

    def _publish(self, step: LiveStep) -> None:
        before, report = self._last, step.report
        self._last = report
        self._tally.add(step)
        if before is None or (before.health, before.segment) != (report.health, report.segment):
            reason = f": {report.reason}" if report.reason else ""
            self._progress.message(f"{report.health}, segment {report.segment}{reason}")
        for output in self._outputs:
            output.step(step)

    def _notes(self) -> tuple[str, ...]:
        """Notes on the sensor, on data dropped at the input, and on outputs that are not complete."""
        counts = self._intake.guard.counts
        dropped = {
            "event(s) outside the sensor or without a polarity dropped": counts.rejected_events,
            "row(s) with an isolated wrong time stamp dropped": counts.isolated_stamps,
            "sample(s) that are not finite dropped": counts.not_finite,
            "jump(s) of the sensor's clock": counts.jumps,
        }
        counted = (f"{count} {what}" for what, count in dropped.items() if count)
        complaint = (self._gravity.complaint,) if self._gravity.complaint else ()
        outputs = (note for output in self._outputs for note in output.notes())
        return (*self._sensor.notes, *complaint, *self._source.notes(), *counted, *outputs)
