"""Cutting tracks: no piece longer than asked, nothing lost, ends spread over time."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io.tracks.checks import cut_tracks
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, RecordArray


def long_tracks(tracks: int, seconds: float, rate_hz: float = 20.0) -> RecordArray:
    frames = int(seconds * rate_hz)
    rows = np.zeros(frames * tracks, dtype=OBSERVATION_DTYPE)
    rows["t_ns"] = 10**18 + np.repeat((np.arange(frames) / rate_hz * NS_PER_S).astype(np.int64), tracks)
    rows["id"] = np.tile(np.arange(tracks), frames)
    rows["u"] = np.arange(rows.size)
    return rows


def spans_ns(rows: RecordArray) -> np.ndarray:
    return np.array([np.ptp(rows["t_ns"][rows["id"] == track]) for track in np.unique(rows["id"])])


def test_pieces_are_short_and_keep_every_observation() -> None:
    rows = long_tracks(30, 10.0)
    cut = cut_tracks(rows, 1.0)
    assert spans_ns(cut).max() < NS_PER_S
    for name in ("t_ns", "u", "v"):
        np.testing.assert_array_equal(cut[name], rows[name])


def test_a_piece_never_mixes_two_tracks() -> None:
    rows = long_tracks(30, 10.0)
    cut = cut_tracks(rows, 1.0)
    owners = {int(new): set() for new in np.unique(cut["id"])}
    for new, old in zip(cut["id"].tolist(), rows["id"].tolist(), strict=True):
        owners[new].add(old)
    assert all(len(old) == 1 for old in owners.values())
    assert len(owners) == pytest.approx(30 * 10.5, rel=0.05)


def test_cuts_are_staggered() -> None:
    rows = long_tracks(100, 10.0)
    cut = cut_tracks(rows, 1.0)
    ends = np.array([cut["t_ns"][cut["id"] == track].max() for track in np.unique(cut["id"])])
    ends = ends[ends < rows["t_ns"].max()]
    _, count = np.unique(ends, return_counts=True)
    # 100 tracks, 20 frames per piece: five a frame when spread evenly, a hundred when not at all.
    assert count.max() <= 8


def test_short_tracks_stay_whole_apart_from_one_staggered_cut() -> None:
    cut = cut_tracks(long_tracks(20, 0.4), 100.0)
    assert np.unique(cut["id"]).size <= 21


def test_extreme_ids_do_not_overflow() -> None:
    rows = long_tracks(2, 3.0)
    rows["id"] = np.where(rows["id"] == 0, np.iinfo(np.int64).min, np.iinfo(np.int64).max)
    assert spans_ns(cut_tracks(rows, 1.0)).max() < NS_PER_S


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_length_must_be_positive(seconds: float) -> None:
    with pytest.raises(RecordingError, match="positive number of seconds"):
        cut_tracks(long_tracks(2, 1.0), seconds)
