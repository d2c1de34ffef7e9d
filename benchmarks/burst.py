"""A burst of events inside a normal stream: peak memory, what is shed, and whether the estimator continues.

    python benchmarks/burst.py [--rate 50] [--burst 2] [--seconds 6] [--scene event_room] [--only file live]

Simulation. Events of random pixels, at `--rate` million per second for `--burst` seconds, are added in the
middle of a sequence, as a lamp that switches on or a cloud of noise does. "file": `asyneio run` over a file;
"live": `asyneio live` over a loopback socket, sent when due or as fast as the sockets take them, without and
with `--record`. Each also runs without the burst. Memory is that of the process, every 20 ms: anonymous
(which the process needs) and resident (with mapped file pages, which the system takes back when needed).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from asyneio.io import write_events_hdf5
from asyneio.io.calibration.kalibr_writer import camchain_text, imu_noise_text
from asyneio.io.recording.event_source import SAMPLE_DTYPE, join_events
from asyneio.live.protocol import HEADER, MAGIC, frame
from asyneio.types import EVENT_DTYPE, NS_PER_S, EventRecording, RecordArray
from common import table
from sequences import DEFAULT_CACHE, sequence

_STEP_NS, _POLL_S = 4_000_000, 0.02
KINDS = ("file", "live", "live --record")


@dataclass(frozen=True)
class Stream:
    """A sequence with a burst; `rate_hz` zero: without one."""

    scene: str
    seconds: float
    rate_hz: float
    burst_s: float
    cache: Path

    def recording(self) -> EventRecording:
        """The sequence without the burst."""
        return sequence(self.scene, 0, self.seconds, self.cache).recording

    def pieces(self, recording: EventRecording) -> Iterator[tuple[int, RecordArray]]:
        """Begin [ns, camera clock] and events of each 4 ms."""
        rng = np.random.default_rng(0)
        first_ns, last_ns = recording.events["t_ns"][[0, -1]].tolist()
        middle_ns, half_ns = (first_ns + last_ns) // 2, round(self.burst_s * NS_PER_S / 2)
        added = np.zeros(round(self.rate_hz * _STEP_NS / NS_PER_S), dtype=EVENT_DTYPE)
        since_ns = np.linspace(0, _STEP_NS - 1, added.size).astype(np.int64)
        for limit, name in ((recording.width, "x"), (recording.height, "y"), (2, "p")):
            added[name] = rng.integers(0, limit, added.size)
        for start_ns in range(first_ns, last_ns + 1, _STEP_NS):
            bounds = [start_ns, start_ns + _STEP_NS]
            events = np.array(recording.events[slice(*np.searchsorted(recording.events["t_ns"], bounds))])
            if added.size and abs(start_ns - middle_ns) < half_ns:
                added["t_ns"] = start_ns + since_ns
                # Another start each time, so that the events of a pixel are not periodic.
                shift = int(rng.integers(added.size))
                for name in ("x", "y", "p"):
                    added[name] = np.roll(added[name], shift)
                events = join_events([events, added])
                events = events[np.argsort(events["t_ns"], kind="stable")]
            yield start_ns, events


@dataclass
class Memory:
    """Memory of a process over time [MB]: anonymous, resident."""

    anonymous_mb: list[float] = field(default_factory=list)
    resident_mb: list[float] = field(default_factory=list)

    def watch(self, process: subprocess.Popen[str]) -> None:
        """Measure until the process ends."""
        while process.poll() is None:
            try:
                status = Path(f"/proc/{process.pid}/status").read_text()
            except OSError:
                break
            values = dict(line.split(":", 1) for line in status.splitlines())
            if "RssAnon" in values:
                self.anonymous_mb.append(int(values["RssAnon"].split()[0]) / 1e3)
                self.resident_mb.append(int(values["VmRSS"].split()[0]) / 1e3)
            time.sleep(_POLL_S)


def run_file(stream: Stream, folder: Path) -> tuple[Memory, dict[str, object]]:
    """`asyneio run` over a file."""
    recording = stream.recording()
    source = folder / "recording.h5"
    write_events_hdf5(recording, source, (events for _, events in stream.pieces(recording)))
    memory, out = Memory(), folder / "out"
    command = [sys.executable, "-m", "asyneio", "run", str(source), "-o", str(out)]
    environment = {**os.environ, "ASYNEIO_CACHE": str(folder / "cache")}
    # The conversion of the file into the cache is a step of its own in most uses; here it is included.
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True
    )
    memory.watch(process)
    summary = json.loads((out / "summary.json").read_text())
    return memory, {**summary, "status": process.returncode}


def send(port: int, stream: Stream, sent: object) -> None:
    """Send the stream when it is due; `sent` gets the rate in the burst [Mev/s]."""
    recording = stream.recording()
    samples = np.zeros(recording.gyroscope.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = recording.gyroscope["t_ns"]
    samples["gyroscope"] = recording.gyroscope["xyz"]
    samples["accelerometer"] = recording.accelerometer["xyz"]
    size = {"width": recording.width, "height": recording.height, "name": recording.name}
    # Prepared beforehand: only sending takes time.
    prepared = list(stream.pieces(recording))
    first_ns, largest = prepared[0][0], max(events.size for _, events in prepared)
    with _connected(port) as connection:
        connection.sendall(frame(b"H", json.dumps(size).encode()))
        started_s, busy_s, count = time.perf_counter(), 0.0, 0
        for start_ns, events in prepared:
            inertial = samples[slice(*np.searchsorted(samples["t_ns"], [start_ns, start_ns + _STEP_NS]))]
            due_s = (start_ns + _STEP_NS - first_ns) / NS_PER_S
            wait_s = due_s - (time.perf_counter() - started_s)
            time.sleep(max(wait_s, 0.0))
            began_s = time.perf_counter()
            connection.sendall(frame(b"I", inertial.tobytes()))
            connection.sendall(HEADER.pack(MAGIC, b"E", events.nbytes))
            connection.sendall(events.view(np.uint8).data)
            if events.size > largest / 2:
                busy_s += max(time.perf_counter() - began_s, _STEP_NS / NS_PER_S)
                count += events.size
        connection.sendall(frame(b"Z"))
    sent.value = count / busy_s / 1e6 if busy_s else 0.0  # type: ignore[attr-defined]


def _connected(port: int) -> socket.socket:
    """A connection to the command, which takes seconds to start."""
    for _ in range(600):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            time.sleep(0.1)
    raise TimeoutError("the live command does not listen")


def run_live(stream: Stream, folder: Path, record: bool) -> tuple[Memory, dict[str, object]]:
    """`asyneio live` over a socket."""
    recording = stream.recording()
    assert recording.calibration is not None
    (folder / "camera.yaml").write_text(camchain_text(recording.calibration))
    (folder / "imu.yaml").write_text(imu_noise_text(recording.calibration.noise))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "asyneio", "live", f"socket:{port}", "--quiet"]
    command += ["--calibration", str(folder / "camera.yaml"), "--imu", str(folder / "imu.yaml")]
    command += ["--record", str(folder / "out")] if record else []
    context = multiprocessing.get_context("spawn")
    sent = context.Value("d", 0.0)
    sender = context.Process(target=send, args=(port, stream, sent))
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    sender.start()
    memory = Memory()
    memory.watch(process)
    sender.join()
    text = process.stderr.read() if process.stderr else ""
    found: dict[str, object] = {"status": process.returncode, "sent": sent.value, "text": text}
    if record:
        found |= json.loads((folder / "out" / "live" / "summary.json").read_text())
    return memory, found


def row(kind: str, stream: Stream) -> list[str]:
    """Run one kind and describe it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if kind == "file":
            memory, found = run_file(stream, folder)
        else:
            memory, found = run_live(stream, folder, kind != "live")
    text = str(found.get("text", ""))
    remark = str(found.get("shed", "")) or " / ".join(text.strip().splitlines()[-8:])
    health = json.dumps(found.get("health_s", "")) if "health_s" in found else ""
    return [
        kind,
        f"{stream.rate_hz / 1e6:g}",
        f"{found.get('sent', 0.0):.1f}" if kind != "file" else "",
        f"{max(memory.anonymous_mb):.0f}",
        f"{max(memory.resident_mb):.0f}",
        f"{memory.anonymous_mb[-2]:.0f}",
        str(found["status"]),
        f"{health} {remark}",
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="A burst of events.")
    parser.add_argument("--rate", type=float, default=50.0)
    parser.add_argument("--burst", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--scene", default="event_room")
    parser.add_argument("--only", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    chosen = parser.parse_args()
    burst = Stream(chosen.scene, chosen.seconds, 1e6 * chosen.rate, chosen.burst, chosen.cache)
    rows = []
    for kind in chosen.only:
        for stream in (replace(burst, rate_hz=0.0), burst):
            rows.append(row(kind, stream))
            print(" | ".join(rows[-1]), flush=True)
    header = ["", "burst Mev/s", "sent Mev/s", "peak anonymous MB", "peak resident MB", "at the end MB"]
    print("\n" + table([*header, "status", "remark"], rows))


if __name__ == "__main__":
    main()
