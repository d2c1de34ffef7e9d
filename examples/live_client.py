"""Send events and inertial samples of any sensor to `asyneio live socket:5555`:
    asyneio live socket:5555 --calibration camchain-imucam.yaml --imu imu.yaml
    python examples/live_client.py recording.npz

Replace `batches` by a loop over your driver. Times are nanoseconds of one clock, up to the time shift.
"""

import json
import socket
import struct
import sys
import time

import numpy as np

EVENT = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")], align=True)
SAMPLE = np.dtype([("t", "<i8"), ("gyroscope", "<f8", 3), ("accelerometer", "<f8", 3)])


def batches(path, step_ns=5_000_000):
    """Events (EVENT) and samples (SAMPLE) of 5 ms each, when they are due."""
    with np.load(path) as data:
        events, samples = data["events"].astype(EVENT), data["samples"].astype(SAMPLE)
    first, started = min(events["t"][0], samples["t"][0]), time.monotonic()
    for start in range(first, max(events["t"][-1], samples["t"][-1]) + 1, step_ns):
        time.sleep(max(0.0, (start + step_ns - first) / 1e9 - (time.monotonic() - started)))
        cuts = [slice(*np.searchsorted(rows["t"], [start, start + step_ns])) for rows in (events, samples)]
        yield events[cuts[0]], samples[cuts[1]]


def frame(kind, payload=b""):
    """Header and payload: see docs/live.md."""
    return struct.pack("<4sc3xI", b"AIO1", kind, len(payload)) + payload


with socket.create_connection(("127.0.0.1", int(sys.argv[2]) if len(sys.argv) > 2 else 5555)) as connection:
    connection.sendall(frame(b"H", json.dumps({"width": 240, "height": 180, "name": "desk"}).encode()))
    for events, samples in batches(sys.argv[1]):
        connection.sendall(frame(b"I", samples.tobytes()) + frame(b"E", events.tobytes()))
    connection.sendall(frame(b"Z"))
