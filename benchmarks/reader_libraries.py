"""Other libraries that read event files, called as in their documentation.

Each function reads all events of a file and returns their number, the first and the last time [us].
Several have other licences than asyneio, and run in separate processes (`readers.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

Summary = tuple[int, int, int]


def _of(t_us: np.ndarray) -> Summary:
    return len(t_us), round(float(t_us[0])), round(float(t_us[-1]))


def ours(path: Path) -> Summary:
    """asyneio: all pieces as returned by the decoder."""
    from asyneio.io import ReadOptions
    from asyneio.io.open_recording import open_contents

    count, first, last = 0, None, 0
    for events, _ in open_contents(path, ReadOptions()).decode().chunks():
        if events.size:
            first = int(events["t_ns"][0]) if first is None else first
            count, last = count + events.size, int(events["t_ns"][-1])
    return count, (first or 0) // 1000, last // 1000


def numpy_loadtxt(path: Path) -> Summary:
    """As in the tools of the data set."""
    return _of(np.loadtxt(path)[:, 0] * 1e6)


def pandas(path: Path) -> Summary:
    """The parser in C of pandas."""
    import pandas as pd

    return _of(pd.read_csv(path, sep=" ", header=None, names=list("txyp"))["t"].to_numpy() * 1e6)


def _expelliarmus(encoding: str) -> Callable[[Path], Summary]:
    def read(path: Path) -> Summary:
        from expelliarmus import Wizard

        return _of(Wizard(encoding=encoding).read(path)["t"])

    return read


def faery(path: Path) -> Summary:
    """Packets of faery's stream."""
    import faery as library

    return _of(np.concatenate([packet["t"] for packet in library.events_stream_from_file(path)]))


def evlib(path: Path) -> Summary:
    """A lazy frame of polars, collected."""
    import evlib as library

    return _of(library.load_events(str(path)).collect()["t"].to_physical().to_numpy())


def evt3(path: Path) -> Summary:
    """The decoder of the evt3 package."""
    import evt3 as library

    return _of(np.asarray(library.decode_file(str(path)).timestamp))


def aedat(path: Path) -> Summary:
    """The package used by our worker, in this process."""
    import aedat as library

    pieces = [packet["events"]["t"] for packet in library.Decoder(str(path)) if "events" in packet]
    return _of(np.concatenate(pieces))


def dv_processing(path: Path) -> Summary:
    """Batches as arrays."""
    import dv_processing as library

    recording = library.io.MonoCameraRecording(str(path))
    pieces = []
    while (batch := recording.getNextEventBatch()) is not None:
        pieces.append(batch.numpy()["timestamp"])
    return _of(np.concatenate(pieces))


def _h5py(group: str) -> Callable[[Path], Summary]:
    def read(path: Path) -> Summary:
        import hdf5plugin  # noqa: F401

        with h5py.File(path) as file:
            columns: dict[str, Any] = {name: file[f"{group}/{name}"][:] for name in "xypt"}
            scale = 1000 if file[f"{group}/t"].attrs.get("unit") == "ns" else 1
        return _of(columns["t"] // scale)

    return read


def h5py_mvsec(path: Path) -> Summary:
    """The whole table at once."""
    with h5py.File(path) as file:
        return _of(file["davis/left/events"][:][:, 2] * 1e6)


def rosbags(path: Path) -> Summary:
    """All messages deserialised to objects, with the definitions in the bag."""
    from rosbags.highlevel import AnyReader

    times: list[float] = []
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            if connection.msgtype == "dvs_msgs/msg/EventArray":
                message: Any = reader.deserialize(data, connection.msgtype)
                times += [event.ts.sec * 1e6 + event.ts.nanosec / 1e3 for event in message.events]
    return _of(np.array(times))


LIBRARIES: dict[str, Callable[[Path], Summary]] = {
    "asyneio": ours,
    "numpy loadtxt": numpy_loadtxt,
    "pandas": pandas,
    "expelliarmus DAT": _expelliarmus("dat"),
    "expelliarmus EVT2": _expelliarmus("evt2"),
    "expelliarmus EVT3": _expelliarmus("evt3"),
    "faery": faery,
    "evlib": evlib,
    "evt3": evt3,
    "aedat": aedat,
    "dv-processing": dv_processing,
    "h5py columns": _h5py("events"),
    "h5py M3ED": _h5py("prophesee/left"),
    "h5py MVSEC": h5py_mvsec,
    "rosbags": rosbags,
}
