# SPDX-License-Identifier: Apache-2.0
"""Comma-separated numbers with named columns: fast for clean files, line by line for damaged ones.

Integer columns are never converted to float: nanosecond stamps need 61 bits.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.text_lines import FIRST, LastNumber, judge_last_number, open_end_note
from asyneio.types import RecordArray

#: A file with more unreadable lines is the wrong file, not a damaged table.
MAX_BAD_LINES = 20

_INTEGER = re.compile(r"[+-]?[0-9]{1,19}")
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_INT64_LIMIT = 2**63


@dataclass(frozen=True)
class CsvTable:
    """Rows of a file as a record array, and notes on what was skipped."""

    rows: RecordArray
    notes: tuple[str, ...]


def read_csv(path: Path, columns: dict[str, str]) -> CsvTable:
    """Read the named columns (`{"t_ns": "<i8", "u": "<f8"}`), found by the header, in any order.

    Lines without finite numbers are skipped with a note, up to MAX_BAD_LINES. Blank lines and lines that
    start with `#` (after the header) are ignored.

    Raises:
        RecordingError: unreadable, a column is missing, too many bad lines, or no rows.
    """
    lines = _read_lines(path)
    names = _header(path, lines, columns)
    dtype = np.dtype([(name, columns[name]) for name in names])
    notes = _drop_open_end(path, lines)
    rows = _parse_clean(lines[1:], dtype)
    bad: list[int] = []
    if rows is None:
        rows, bad = _parse_tolerant(path, lines[1:], dtype)
    if rows.size == 0:
        raise RecordingError(f"{path} contains no readable row; expected lines of {','.join(columns)}")
    ordered = np.empty(rows.size, dtype=np.dtype(list(columns.items())))
    for name in columns:
        ordered[name] = rows[name]
    return CsvTable(ordered, notes + bad_lines_note(path, bad))


def has_columns(path: Path, columns: dict[str, str]) -> bool:
    """True if the first line of a file names exactly these columns, in any order."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as stream:
            found = [name.strip() for name in stream.readline(4096).strip().lstrip("#").split(",")]
    except OSError:
        return False
    return sorted(found) == sorted(columns)


class TextFile(Protocol):
    """A file that can be read as text: a path, or a file in an archive."""

    @property
    def name(self) -> str:
        """Its name without folders."""

    def is_file(self) -> bool:
        """True if the file exists."""

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        """Its content."""


def read_text(path: TextFile) -> str:
    """The text of a file, with undecodable bytes replaced. Raises RecordingError: unreadable."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}; check the path") from error


def bad_lines_note(path: TextFile, bad: list[int]) -> tuple[str, ...]:
    """A note on skipped lines (their numbers, from 1); empty if there are none."""
    if not bad:
        return ()
    shown = ", ".join(map(str, bad[:5])) + (", ..." if len(bad) > 5 else "")
    return (f"{path.name}: skipped {len(bad)} unreadable line(s), number {shown}",)


def _read_lines(path: Path) -> list[str]:
    lines = read_text(path).replace("\r\n", "\n").split("\n")
    if lines[0].startswith("\ufeff"):
        lines[0] = lines[0][1:]
    return lines


def _drop_open_end(path: Path, lines: list[str]) -> tuple[str, ...]:
    """Remove a last line without a line feed whose last number may lack digits; a note if it was removed."""
    if not lines[-1].strip() or len(lines) < 2:
        return ()
    before = [line.rsplit(",", 1)[-1].strip() for line in lines[1:-1][:FIRST] if _is_row(line)]
    state = judge_last_number(before, lines[-1].rsplit(",", 1)[-1].strip())
    if state is LastNumber.COMPLETE or not _is_row(lines[-1]):
        return ()
    lines.pop()
    return (open_end_note(path.name, len(lines) + 1, state),)


def _is_row(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _header(path: Path, lines: list[str], columns: dict[str, str]) -> list[str]:
    """Column names in file order, checked against the expected ones."""
    found = [name.strip() for name in lines[0].strip().lstrip("#").split(",")]
    if sorted(found) != sorted(columns):
        raise RecordingError(
            f"{path} starts with {lines[0].strip()[:80]!r}; expected a header line naming the columns "
            f"{','.join(columns)} (SI units, whole nanoseconds)"
        )
    return found


def _parse_clean(lines: list[str], dtype: np.dtype[np.void]) -> RecordArray | None:
    """All rows at once; None if a line has to be parsed individually."""
    if all(not line.strip() or line.lstrip().startswith("#") for line in lines):
        return np.empty(0, dtype=dtype)
    try:
        rows = np.loadtxt(lines, delimiter=",", dtype=dtype, ndmin=1)
    except (ValueError, OverflowError, DeprecationWarning):
        return None
    finite = all(np.isfinite(rows[name]).all() for name in dtype.names or ())
    return rows if finite else None


def _parse_tolerant(path: Path, lines: list[str], dtype: np.dtype[np.void]) -> tuple[RecordArray, list[int]]:
    """Line by line: the good rows and the numbers of the bad lines."""
    integer = [dtype[name].kind == "i" for name in dtype.names or ()]
    rows: list[tuple[float, ...]] = []
    bad: list[int] = []
    for number, line in enumerate(lines, start=2):
        text = line.split("#", 1)[0].strip()
        if not text:
            continue
        row = _parse_row(text, integer)
        if row is not None:
            rows.append(row)
            continue
        bad.append(number)
        if len(bad) > MAX_BAD_LINES:
            raise RecordingError(
                f"{path} has more than {MAX_BAD_LINES} unreadable lines, the last at {number}: "
                f"{text[:60]!r}; expected {len(integer)} finite numbers per line, times in whole nanoseconds"
            )
    return np.array(rows, dtype=dtype), bad


def _parse_row(text: str, integer: list[bool]) -> tuple[float, ...] | None:
    tokens = [token.strip() for token in text.split(",")]
    if len(tokens) != len(integer):
        return None
    values: list[float] = []
    for token, is_integer in zip(tokens, integer, strict=True):
        value = _parse_number(token, is_integer)
        if value is None:
            return None
        values.append(value)
    return tuple(values)


def _parse_number(token: str, is_integer: bool) -> float | None:
    if is_integer:
        if not _INTEGER.fullmatch(token) or not -_INT64_LIMIT <= int(token) < _INT64_LIMIT:
            return None
        return int(token)
    if not _DECIMAL.fullmatch(token):
        return None
    value = float(token)
    return value if math.isfinite(value) else None
