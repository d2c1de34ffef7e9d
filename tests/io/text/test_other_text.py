"""Event text of other programs: columns in any order and unit, packed, with errors that name the fix."""

from __future__ import annotations

import gzip
import subprocess
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from tests.io.event_columns import T0_US, assert_events, read

TEXTS = {
    "Metavision": ("", "{x},{y},{p},{t}", 0, "x y p t, time in microseconds"),
    "tabs": ("", "{x}\t{y}\t{p}\t{t}", 57_922_807_588, "x y p t, time in microseconds"),
    "DV": ("\ufefftimestamp,x,y,polarity\r\n", "{t},{x},{y},{p}\r", T0_US, "by their names"),
    "pandas": (",timestamp,x,y,polarity\n", "7,{t},{x},{y},{p}", T0_US, "by their names"),
    "microseconds": ("", "{t} {x} {y} {p}", T0_US, "t x y p, time in microseconds (stamps since 1970)"),
    "named unit": ("# x y t[us] p\n", "{x} {y} {t} {p}", 0, "time in microseconds (by its name)"),
    "N-MNIST": ("", "{x} {y} {t} {p}", 0, "x y t p, time in microseconds"),
    "quotes": ('"t","x","y","p"\n', '"{t}","{x}","{y}","{p}"', T0_US, "by their names"),
    "spreadsheet": ("t,x,y,p\n", '"{t:,}",{x},{y},{p}', T0_US, "by their names"),
    "further column": ("", "{t} {x} {y} {p} 7", T0_US, "1 further column(s) ignored"),
}


@pytest.mark.parametrize("layout", TEXTS)
@pytest.mark.parametrize("packed", [False, True])
def test_text_of_others(tmp_path: Path, events: np.ndarray, layout: str, packed: bool) -> None:
    header, line, offset, said = TEXTS[layout]
    rows = (line.format(t=t + offset, x=x, y=y, p=p) + "\n" for t, x, y, p in events.tolist())
    text = (header + "".join(rows)).encode()
    if packed:
        (tmp_path / "events.csv.gz").write_bytes(gzip.compress(text))
    else:
        (tmp_path / "events.csv").write_bytes(text)
    found = read(tmp_path)
    assert_events(found.events, events, offset)
    assert said in " ".join(found.notes)
    assert "unreadable" not in " ".join(found.notes)


def test_nanoseconds_of_the_epoch_are_exact(tmp_path: Path) -> None:
    stamps = [T0_US * 1000 + k for k in (1, 2, 999)]
    (tmp_path / "events.txt").write_text("".join(f"{t} 5 6 1\n" for t in stamps))
    assert read(tmp_path).events["t_ns"].tolist() == stamps


def test_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "events.txt").write_bytes(b"\xef\xbb\xbf0.5 1 2 1\r\n0.6 1 2 0\r\n")
    found = read(tmp_path)
    assert found.events["t_ns"].tolist() == [500_000_000, 600_000_000]
    assert not any("unreadable" in note for note in found.notes)


def test_decimal_commas_are_named_and_the_cure_works(tmp_path: Path, events: np.ndarray) -> None:
    rows = ((t, x, y, p) for t, x, y, p in events.tolist())
    file = tmp_path / "events.txt"
    file.write_text("".join(f"5,{t:06d};{x};{y};{p}\n" for t, x, y, p in rows))
    with pytest.raises(RecordingError, match="decimal commas") as caught:
        open_recording(tmp_path)
    command = str(caught.value).split("Type: ")[1].split(")")[0]
    assert "'5," in str(caught.value)
    subprocess.run(command, shell=True, cwd=tmp_path, check=True)
    assert_events(read(tmp_path).events, events, 5_000_000)


def test_rows_out_of_order_are_named_and_the_cure_works(tmp_path: Path, events: np.ndarray) -> None:
    order = np.lexsort((events[:, 1], events[:, 0] // 33_000))
    lines = (f"{t / 1e6:.6f} {x} {y} {p}\n" for t, x, y, p in events[order].tolist())
    (tmp_path / "events.txt").write_text("".join(lines))
    with pytest.raises(RecordingError, match="not sorted by time") as caught:
        open_recording(tmp_path)
    command = str(caught.value).split("Sort it, in its folder: ")[1]
    subprocess.run(f"{command} && mv sorted.txt events.txt", shell=True, cwd=tmp_path, check=True)
    assert_events(read(tmp_path).events, events)


def test_polarity_in_words(tmp_path: Path, events: np.ndarray) -> None:
    rows = (f"{t},{x},{y},{'ON' if p else 'off'}\n" for t, x, y, p in events.tolist())
    (tmp_path / "events.csv").write_text("t[us],x,y,p\n" + "".join(rows))
    assert_events(read(tmp_path).events, events)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{t} {x} {y}", "3 columns without names.*or the polarity is missing"),
        ("{t} {x} {y} {q}", "column 4 has the values 1 and 2: a polarity is 0 and 1"),
        ("{x} {t} {y} {p}", "name the columns in the first line, such as"),
        ("0.5 {x}.25 {y}.5 7", "no two columns are integers"),
    ],
)
@pytest.mark.parametrize("name", ["events.txt", "other.txt"])
def test_columns_of_other_tables_are_named(
    tmp_path: Path, events: np.ndarray, line: str, said: str, name: str
) -> None:
    rows = (line.format(t=T0_US + t, x=x, y=y, p=p, q=p + 1) + "\n" for t, x, y, p in events.tolist())
    (tmp_path / name).write_text("".join(rows))
    with pytest.raises(RecordingError, match=said) as caught:
        open_recording(tmp_path)
    assert "the first line of numbers is" in str(caught.value)


def test_the_advice_to_name_columns_works(tmp_path: Path, events: np.ndarray) -> None:
    rows = "".join(f"{x} {T0_US + t} {y} {p}\n" for t, x, y, p in events.tolist())
    (tmp_path / "events.txt").write_text("x t[us] y p\n" + rows)
    assert_events(read(tmp_path).events, events, T0_US)


def test_utf16_is_named_and_the_command_works(tmp_path: Path, events: np.ndarray) -> None:
    rows = "".join(f"{t},{x},{y},{p}\n" for t, x, y, p in events.tolist())
    (tmp_path / "my events.csv").write_bytes(("t,x,y,p\n" + rows).encode("utf-16"))
    with pytest.raises(RecordingError, match="UTF-16") as caught:
        open_recording(tmp_path)
    command = str(caught.value).split("Type: ")[1].split(")")[0]
    subprocess.run(command, shell=True, check=True)
    assert_events(read(tmp_path).events, events)
