"""The file of results: what was written is read, what is damaged is told."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import StudyError
from asyneio.studies.records import Record, append, appending, latest, read_records

_RECORD = Record({"method": "gpp", "knot_s": 0.05, "seed": 3}, "s", "c", {"error": 0.1, "lost": math.nan})


def write(path: Path, *records: Record) -> None:
    with appending(path) as stream:
        for record in records:
            append(stream, record)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    failed = Record({"seed": 4}, "s", "c", {}, "ValueError: no")
    write(tmp_path / "r", _RECORD)
    write(tmp_path / "r", failed)
    first, second = read_records(tmp_path / "r")
    assert first.task == _RECORD.task
    assert first.measured["error"] == 0.1
    assert math.isnan(first.measured["lost"])
    assert second == failed
    assert b"NaN" not in (tmp_path / "r").read_bytes()


def test_no_file_is_no_results(tmp_path: Path) -> None:
    assert read_records(tmp_path / "r") == []


@given(st.integers(min_value=0, max_value=120))
def test_a_torn_end_costs_the_torn_line_only(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    path = tmp_path_factory.mktemp("torn") / "r"
    write(path, _RECORD, _RECORD)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) - min(cut, len(whole) // 2)])
    left = len(read_records(path))
    assert left == (2 if cut == 0 else 1)
    write(path, _RECORD)
    assert len(read_records(path)) == left + 1


@pytest.mark.parametrize("line", [b"{", b"[]", b"{}", b'{"task": {}, "measured": {"x": "y"}}', b"\xff"])
def test_damage_elsewhere_names_the_line(tmp_path: Path, line: bytes) -> None:
    write(tmp_path / "r", _RECORD)
    (tmp_path / "r").write_bytes((tmp_path / "r").read_bytes() + line + b"\n")
    write(tmp_path / "r", _RECORD)
    with pytest.raises(StudyError, match=r"line 2 of .* is not a result of a study.*remove that line"):
        read_records(tmp_path / "r")


def test_the_last_record_of_a_task_counts() -> None:
    old, new = ({"error": 1.0}, {"error": 2.0})
    records = [
        Record({"seed": 1, "a": "b"}, "s", "c", old),
        Record({"a": "b", "seed": 1}, "s", "c", new),
        Record({"a": "b", "seed": 1}, "other", "c", old),
    ]
    (record,) = latest(records, "s").values()
    assert record.measured == new
