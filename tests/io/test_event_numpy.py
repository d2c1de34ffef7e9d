"""NumPy files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from tests.io.event_columns import T0_US, assert_events, read


def npz(path: Path, events: np.ndarray) -> None:
    t, x, y, p = events.T
    np.savez(path, x=x.astype("u2"), y=y.astype("u2"), t=t + T0_US, p=p.astype(bool))


def npz_of_one_array(path: Path, events: np.ndarray) -> None:
    np.savez(path, events=events[:, [1, 2, 3, 0]] + np.array([0, 0, 0, T0_US]))


def npy(path: Path, events: np.ndarray) -> None:
    with path.open("wb") as stream:
        np.save(stream, (events + np.array([T0_US, 0, 0, 0])).astype(np.float64))


def npy_of_fields(path: Path, events: np.ndarray) -> None:
    table = np.zeros(len(events), [("x", "<u2"), ("y", "<u2"), ("p", "i1"), ("timestamp", "<i8")])
    table["timestamp"], table["x"], table["y"] = events[:, 0] + T0_US, events[:, 1], events[:, 2]
    table["p"] = 2 * events[:, 3] - 1
    with path.open("wb") as stream:
        np.save(stream, table)


def npz_of_long_names(path: Path, events: np.ndarray) -> None:
    t, x, y, p = events.T
    np.savez(path, event_timestamps=t + T0_US, x_pos=x.astype("u2"), y_pos=y.astype("u2"), pols=p)


def npz_of_pixels(path: Path, events: np.ndarray) -> None:
    """As EVIMO2: column and row in one array."""
    np.savez(
        path, events_t=events[:, 0] + T0_US, events_xy=events[:, 1:3].astype("u2"), events_p=events[:, 3]
    )


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.npz", npz),
        ("b.npz", npz_of_one_array),
        ("c.npy", npy),
        ("d.npy", npy_of_fields),
        ("e.npz", npz_of_long_names),
        ("f.npz", npz_of_pixels),
    ],
)
def test_numpy(
    tmp_path: Path, events: np.ndarray, name: str, write: Callable[[Path, np.ndarray], None]
) -> None:
    write(tmp_path / name, events)
    assert_events(read(tmp_path).events, events, T0_US)


def test_numpy_without_events_lists_what_it_holds(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", depth=np.zeros((3, 4, 5)), index=np.array([{}], dtype=object))
    with pytest.raises(
        RecordingError, match=r"contains depth \(3, 4, 5\) of float64; expected arrays named t, x"
    ):
        open_recording(tmp_path / "a.npz")
