"""A live run over a loopback socket: latency, shed load, memory, and agreement with `asyneio run`.

    python benchmarks/live.py [--scene event_fast] [--seconds 60] [--multiply 1] [--speed 1.0]

Simulation. A process of its own sends the sequence in pieces of 4 ms when they are due, over the protocol of
`asyneio live socket:`. With `--multiply 8` every event is sent eight times in a row, as a sensor with a far
lower contrast threshold would: 20 Mev/s from a sequence of 2.5 Mev/s. Latency is from the arrival of the
first datum as new as the pose to the pose, so it contains `frontend.max_delay_s` (60 ms); processing is from
the arrival of the last datum that the pose needs. All runs on the cores of this machine, with the sender.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import socket
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asyneio.config import Config
from asyneio.io.calibration.kalibr_writer import camchain_text, imu_noise_text
from asyneio.io.recording.event_source import SAMPLE_DTYPE
from asyneio.live.chunks import Sensor
from asyneio.live.engine import run_live
from asyneio.live.options import LiveOptions
from asyneio.live.protocol import HEADER, MAGIC, frame
from asyneio.live.sources import CalibrationOptions
from asyneio.live.sources.socket import SocketSource
from asyneio.live.step import LiveStep
from asyneio.live.summary import LiveSummary
from asyneio.pipeline import run_recording
from asyneio.types import NS_PER_S, Estimate, EventRecording
from common import table
from sequences import DEFAULT_CACHE, sequence

_STEP_NS = 4_000_000


@dataclass(frozen=True)
class Sending:
    """What is sent, and how."""

    scene: str
    seconds: float
    cache: Path
    multiply: int
    speed: float


def send(port: int, sending: Sending, lag_s: object) -> None:
    """Send a sequence when it is due; `lag_s` gets how far the sender fell behind at most."""
    recording = sequence(sending.scene, 0, sending.seconds, sending.cache).recording
    samples = np.zeros(recording.gyroscope.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = recording.gyroscope["t_ns"]
    samples["gyroscope"] = recording.gyroscope["xyz"]
    samples["accelerometer"] = recording.accelerometer["xyz"]
    stamps = [rows["t_ns"][[0, -1]].tolist() for rows in (samples, recording.events)]
    first_ns, last_ns = min(t[0] for t in stamps), max(t[1] for t in stamps) + 1
    size = {"width": recording.width, "height": recording.height, "name": recording.name}
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(frame(b"H", json.dumps(size).encode()))
        started_s, worst_s = time.perf_counter(), 0.0
        for start_ns in range(first_ns, last_ns, _STEP_NS):
            bounds = [start_ns, start_ns + _STEP_NS]
            events = np.array(recording.events[slice(*np.searchsorted(recording.events["t_ns"], bounds))])
            events = np.repeat(events, sending.multiply) if sending.multiply > 1 else events
            inertial = samples[slice(*np.searchsorted(samples["t_ns"], bounds))]
            due_s = (bounds[1] - first_ns) / NS_PER_S / sending.speed
            wait_s = due_s - (time.perf_counter() - started_s)
            worst_s = max(worst_s, -wait_s)
            time.sleep(max(wait_s, 0.0))
            connection.sendall(frame(b"I", inertial.tobytes()))
            connection.sendall(HEADER.pack(MAGIC, b"E", events.nbytes))
            connection.sendall(events.view(np.uint8).data)
        connection.sendall(frame(b"Z"))
    lag_s.value = worst_s  # type: ignore[attr-defined]


class Collect:
    """Estimates, and memory over time."""

    def __init__(self) -> None:
        self.estimates: list[Estimate] = []
        self.rss_mb: list[float] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def begin(self, sensor: Sensor) -> None:
        """See `Output`."""
        self._thread.start()

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        self.estimates += step.estimates

    def end(self) -> None:
        """See `Output`."""
        self._stop.set()

    def notes(self) -> tuple[str, ...]:
        """See `Output`."""
        return ()

    def _watch(self) -> None:
        while not self._stop.wait(1.0):
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            self.rss_mb.append(pages * resource.getpagesize() / 1e6)


def live(sending: Sending, recording: EventRecording, backlog_s: float) -> tuple[LiveSummary, Collect, float]:
    """The live run, what it gave, and how far the sender fell behind [s]."""
    assert recording.calibration is not None
    collect, lag_s = Collect(), multiprocessing.get_context("spawn").Value("d", 0.0)
    with tempfile.TemporaryDirectory() as folder:
        rig = CalibrationOptions(Path(folder) / "camera.yaml", Path(folder) / "imu.yaml")
        (Path(folder) / "camera.yaml").write_text(camchain_text(recording.calibration))
        (Path(folder) / "imu.yaml").write_text(imu_noise_text(recording.calibration.noise))
        source = SocketSource("127.0.0.1", 0, rig)
        sender = multiprocessing.get_context("spawn").Process(target=send, args=(source.port, sending, lag_s))
        sender.start()
        summary = run_live(source, Config(), [collect], None, LiveOptions(max_backlog_s=backlog_s))
        sender.join()
    return summary, collect, float(lag_s.value)


def same(found: list[Estimate], wanted: list[Estimate]) -> str:
    """How the poses agree with those of a recording."""
    by_time = {estimate.t_ns: estimate for estimate in wanted}
    pairs = [(a, by_time[a.t_ns]) for a in found if a.t_ns in by_time]
    fields = ("T_w_b", "velocity_w", "covariance")
    equal = all(np.array_equal(getattr(a, f), getattr(b, f)) for a, b in pairs for f in fields)
    if equal and len(pairs) == len(found) == len(wanted):
        return f"all {len(found)} to the bit"
    differences = (float(np.linalg.norm((a.T_w_b - b.T_w_b)[:3, 3])) for a, b in pairs)
    worst_m = max(differences, default=float("nan"))
    return f"no: {len(found)} against {len(wanted)}, positions differ by up to {100 * worst_m:.1f} cm"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description="A live run over a loopback socket.")
    parser.add_argument("--scene", default="event_fast")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--multiply", type=int, default=1)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--max-backlog", type=float, default=0.5)
    parser.add_argument("--no-reference", action="store_true")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    chosen = parser.parse_args()
    recording = sequence(chosen.scene, 0, chosen.seconds, chosen.cache).recording
    rate = recording.events.size / chosen.seconds * chosen.multiply * chosen.speed / 1e6
    sending = Sending(chosen.scene, chosen.seconds, chosen.cache, chosen.multiply, chosen.speed)
    busy = os.getloadavg()[0]
    cpu_s = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    summary, collect, lag_s = live(sending, recording, chosen.max_backlog)
    used_s = sum(resource.getrusage(resource.RUSAGE_SELF)[:2]) - cpu_s
    agreement = "not compared"
    if not chosen.no_reference and chosen.multiply == 1:
        agreement = same(collect.estimates, run_recording(recording, Config()).run.estimates)
    rows = [
        ["rate sent", f"{rate:.2f} Mev/s for {summary.wall_s:.0f} s, {os.cpu_count()} cores"],
        ["processor time", f"{used_s:.1f} s, {used_s / summary.duration_s:.2f} s a second of sensor time"],
        ["load of the machine before and after", f"{busy:.1f}, {os.getloadavg()[0]:.1f}"],
        ["sender behind by at most", f"{1e3 * lag_s:.0f} ms"],
        ["latency, median / 99 % / largest", _milliseconds(summary.latency_ms)],
        ["processing, median / 99 % / largest", _milliseconds(summary.processing_ms)],
        ["longest wait in the inbox", f"{1e3 * summary.longest_backlog_s:.0f} ms"],
        ["front end, estimator busy", f"{summary.frontend_s:.1f} s, {summary.estimator_s:.1f} s"],
        ["shed", str(summary.shed)],
        ["health", json.dumps(summary.health_s)],
        ["segments", str(summary.segments)],
        ["poses as those of `asyneio run`", agreement],
        ["memory, each tenth of the run", " ".join(f"{rss:.0f}" for rss in _tenths(collect.rss_mb)) + " MB"],
    ]
    print(table(["", f"{chosen.scene} x {chosen.multiply}, speed {chosen.speed:g}"], rows))
    for transition in summary.transitions:
        print(f"  {transition.t_ns / 1e9:.2f} {transition.health} {transition.reason}")


def _milliseconds(values: tuple[float, float, float]) -> str:
    return " / ".join(f"{value:.0f}" for value in values) + " ms"


def _tenths(values: list[float]) -> list[float]:
    return [values[round(k)] for k in np.linspace(0, len(values) - 1, min(10, len(values)))] if values else []


if __name__ == "__main__":
    main()
