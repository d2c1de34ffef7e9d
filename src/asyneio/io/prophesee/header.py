# SPDX-License-Identifier: Apache-2.0
"""The header of Prophesee's RAW and DAT files: lines `% keyword value`, ended by `% end` or by the data.

Keywords differ between camera generations (docs.prophesee.ai):

| content | keywords |
|---|---|
| encoding (RAW) | `format EVT3;height=720;width=1280`; `evt 3.0` |
| sensor size | `geometry 1280x720`; DAT: `Width`, `Height`; else from the generation in `plugin_name` |
| version (DAT) | `Version 2` |
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from asyneio.errors import RecordingError

MAGIC = b"% "

_MAX_HEADER_BYTES = 2**20
_MAX_LINE_BYTES = 4096
_MAX_PIXELS = 65_534
#: Sensor sizes by the start of the name of the plugin or sensor.
_SENSORS = {
    "gen31": (640, 480),
    "gen3": (640, 480),
    "gen4": (1280, 720),
    "imx636": (1280, 720),
    "imx646": (1280, 720),
    "genx320": (320, 320),
}


@dataclass(frozen=True)
class Header:
    """Keywords with their values, and the position of the data."""

    fields: Mapping[str, str]
    data_start: int

    @property
    def encoding(self) -> str:
        """Encoding of a RAW file, such as "EVT2"; "" if not given."""
        named = self.fields.get("format", "").split(";")[0].strip().upper()
        if named:
            return named
        version = self.fields.get("evt", "").strip()
        whole, _, part = version.partition(".")
        return f"EVT{whole}{part.rstrip('0')}" if version else ""

    @property
    def is_dat(self) -> bool:
        """True for a DAT file, which has a version but no encoding."""
        return not self.encoding and "version" in self.fields

    @property
    def big_endian(self) -> bool:
        """True if the words of a RAW file begin with their high byte."""
        return "endianness=big" in self.fields.get("format", "").replace(" ", "").lower() or (
            self.fields.get("endianness", "").strip().lower() == "big"
        )

    @property
    def high_half_first(self) -> bool | None:
        """Whether a 64-bit word begins with its high half; None if the header gives no byte order."""
        text = f"{self.fields.get('format', '')};endianness={self.fields.get('endianness', '')}".lower()
        if "endianness=legacy" in text.replace(" ", ""):
            return True
        return False if re.search(r"endianness=(little|big)", text.replace(" ", "")) else None


def parse_header(start: bytes, path: Path) -> Header:
    """The header in the first bytes of a file. Raises RecordingError: no header."""
    if not start.startswith(MAGIC):
        raise RecordingError(f"{path} is not a Prophesee file: it starts with {start[:16]!r}")
    fields: dict[str, str] = {}
    position = 0
    while start[position : position + 2] == MAGIC:
        end = start.find(b"\n", position, position + _MAX_LINE_BYTES)
        line = start[position:end]
        # Data may start with the same two characters as a header line, but then no text follows.
        if end < 0 or not line.rstrip(b"\r").isascii() or any(byte < 32 for byte in line.strip()):
            break
        position = end + 1
        keyword, _, value = line[2:].decode("ascii").strip().partition(" ")
        fields[keyword.lower()] = value.strip()
        if keyword == "end":
            break
    return Header(fields, position)


def read_header(path: Path) -> Header:
    """Like `parse_header`, for a file. Raises RecordingError: unreadable, or no header."""
    try:
        with path.open("rb") as stream:
            return parse_header(stream.read(_MAX_HEADER_BYTES), path)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def size_of(fields: Mapping[str, str]) -> tuple[tuple[int, int] | None, tuple[str, ...]]:
    """Width and height of the sensor [px] (None if not given), and a note if derived from the sensor name."""
    pairs = [
        re.fullmatch(r"(\d{1,5})\s*x\s*(\d{1,5})", fields.get("geometry", "")),
        re.search(r"width=(\d{1,5});height=(\d{1,5})", _sorted_format(fields)),
        re.fullmatch(r"(\d{1,5}) (\d{1,5})", f"{fields.get('width')} {fields.get('height')}"),
    ]
    for pair in pairs:
        if pair and all(0 < int(length) <= _MAX_PIXELS for length in pair.groups()):
            return (int(pair.group(1)), int(pair.group(2))), ()
    named = f"{fields.get('plugin_name', '')} {fields.get('sensor_name', '')}".lower()
    for sensor, size in _SENSORS.items():
        if sensor in named:
            return size, (
                f"sensor size assumed from the {sensor} named in the header: {size[0]} x {size[1]}",
            )
    return None, ()


def _sorted_format(fields: Mapping[str, str]) -> str:
    """Parameters of the format, width before height."""
    parameters = fields.get("format", "").replace(" ", "").lower().split(";")[1:]
    return ";".join(sorted(parameters, reverse=True))
