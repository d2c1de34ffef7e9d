# SPDX-License-Identifier: Apache-2.0
"""Prophesee files: RAW in the encodings EVT 2.0, 2.1 and 3.0, and DAT. They contain events only."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import find_calibration
from asyneio.io.prophesee.dat import CD_KINDS, RECORD_BYTES, VERSION, DatDecoder
from asyneio.io.prophesee.evt2 import Evt2Decoder
from asyneio.io.prophesee.evt3 import Evt3Decoder
from asyneio.io.prophesee.evt21 import Evt21Decoder
from asyneio.io.prophesee.header import Header, read_header, size_of
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.event_source import SAMPLE_DTYPE
from asyneio.io.recording.sidecar import find_ground_truth, find_samples
from asyneio.types import RecordArray

#: Small enough for the allocator to reuse memory.
CHUNK_BYTES = 2**20


class Decoder(Protocol):
    """Decodes words to events, piece by piece."""

    def feed(self, words: np.ndarray, last: bool = False) -> RecordArray:
        """Events of the next words."""

    def notes(self, name: str) -> tuple[str, ...]:
        """Notes on what was skipped."""


@dataclass(frozen=True)
class _Encoding:
    """How the data of a file are divided into words; `unit_bytes` must stay together."""

    decoder: Callable[[], Decoder]
    words: str
    unit_bytes: int


_RAW = {"EVT2": _Encoding(Evt2Decoder, "u4", 4), "EVT3": _Encoding(Evt3Decoder, "u2", 2)}
#: By the order of the halves of a word in the header; None: detect it from the words.
_EVT21 = {swapped: _Encoding(partial(Evt21Decoder, swapped), "u8", 8) for swapped in (None, False, True)}
_DAT = _Encoding(DatDecoder, "u4", RECORD_BYTES)
#: Descriptions of unsupported encodings.
_UNSUPPORTED = {
    "EVT4": "EVT 4.0",
    "HISTO3D": "frames of histograms, not events",
    "DIFF3D": "frames of differences, not events",
}


class PropheseeEvents:
    """An EventSource on a RAW or DAT file."""

    def __init__(self, path: Path, start: int, encoding: _Encoding, big_endian: bool) -> None:
        self.path = path
        self._start = start
        self._encoding = encoding
        self._dtype = np.dtype(f"{'>' if big_endian else '<'}{encoding.words}")
        self._notes: tuple[str, ...] = ()

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable."""
        decoder, rest = self._encoding.decoder(), b""
        try:
            with self.path.open("rb") as stream:
                size = max(self.path.stat().st_size, 1)
                stream.seek(self._start)
                while block := stream.read(CHUNK_BYTES):
                    data = rest + block
                    whole = len(data) - len(data) % self._encoding.unit_bytes
                    rest = data[whole:]
                    yield decoder.feed(np.frombuffer(data[:whole], self._dtype)), stream.tell() / size
        except OSError as error:
            raise RecordingError(f"cannot read {self.path}: {error.strerror or error}") from error
        try:
            end = decoder.feed(np.empty(0, self._dtype), last=True)
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}") from error
        yield end, 1.0
        self._notes = decoder.notes(self.path.name)
        if rest:
            self._notes += (
                f"{self.path.name}: {len(rest)} byte(s) at the end are not a complete event: truncated?",
            )

    def samples(self) -> RecordArray:
        """Empty: these files contain events only."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Notes on words that are not events, and on a truncated file."""
        return self._notes


def read_prophesee(path: Path, options: ReadOptions) -> Contents:
    """A RAW or DAT file, with inertial samples and ground truth from sidecar files.

    Raises:
        RecordingError: unreadable, or an unsupported encoding.
        CalibrationError: a calibration file is malformed or impossible.
    """
    header = read_header(path)
    encoding, start = _dat(path, header) if header.is_dat else (_raw(path, header), header.data_start)
    size, notes = size_of(header.fields)
    truth, truth_notes = find_ground_truth(path.parent)
    return Contents(
        path.resolve().stem,
        partial(PropheseeEvents, path, start, encoding, header.big_endian),
        size,
        find_calibration(path.parent, options.calibration, options.imu),
        find_samples(path.parent, options),
        ground_truth=truth,
        notes=notes + truth_notes,
    )


def _raw(path: Path, header: Header) -> _Encoding:
    name = header.encoding
    if name in _RAW:
        return _RAW[name]
    if name == "EVT21":
        return _EVT21[header.high_half_first]
    if not name:
        found = ", ".join(header.fields)[:200] or "none"
        raise RecordingError(
            f"{path} has a Prophesee header without an encoding (keywords: {found}); expected a line "
            "'% evt 2.0', '% evt 3.0' or '% format EVT3;...'"
        )
    raise RecordingError(
        f"{path} is a Prophesee RAW file in {_UNSUPPORTED.get(name, name[:40])}, which is not supported; "
        "convert it with Metavision (metavision_file_to_dat) or record in EVT 2.0, 2.1 or 3.0"
    )


def _dat(path: Path, header: Header) -> tuple[_Encoding, int]:
    """Encoding of a DAT file, and the position of its first record."""
    version = header.fields["version"]
    if version != str(VERSION):
        raise RecordingError(f"{path} is DAT of version {version[:40]}; expected version {VERSION}")
    try:
        with path.open("rb") as stream:
            stream.seek(header.data_start)
            kind = stream.read(2)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    if len(kind) < 2:
        raise RecordingError(f"{path} contains only a header")
    if kind[0] not in CD_KINDS or kind[1] != RECORD_BYTES:
        raise RecordingError(
            f"{path} contains events of type {kind[0]:#04x} with {kind[1]} bytes each; expected changes of "
            f"brightness (type 0x00 or 0x0c) with {RECORD_BYTES}"
        )
    return _DAT, header.data_start + 2
