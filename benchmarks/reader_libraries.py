"""Other libraries that read files of events, each through the calls of its documentation.

Each function reads all events of a file and returns how many there are, the first and the last time [us].
Several are under other licences than ours: they run in a process of their own (`readers.py`).
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
    """asyneio: every piece, as it comes from the decoder."""
    from asyneio.io import ReadOptions
    from asyneio.io.open_recording import open_contents

    count, first, last = 0, None, 0
    for events, _ in open_contents(path, ReadOptions()).decode().chunks():
        if events.size:
            first = int(events["t_ns"][0]) if first is None else first
            count, last = count + events.size, int(events["t_ns"][-1])
    return count, (first or 0) // 1000, last // 1000


def numpy_loadtxt(path: Path) -> Summary:
    """What the data set's own tools do."""
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
    """The package behind our worker, in this process."""
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
}
