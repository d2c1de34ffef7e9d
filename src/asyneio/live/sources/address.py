# SPDX-License-Identifier: Apache-2.0
"""The source that a text of the command line names."""

from __future__ import annotations

from pathlib import Path

from asyneio.errors import LiveError
from asyneio.io import ReadOptions
from asyneio.live.chunks import Source
from asyneio.live.sources.calibration import CalibrationOptions
from asyneio.live.sources.dv import DvSource
from asyneio.live.sources.file import FileSource
from asyneio.live.sources.socket import SocketSource
from asyneio.live.sources.usb import UsbSource

LOOPBACK = "127.0.0.1"
_EXPECTED = (
    "expected file:PATH, dv:[HOST:]PORT[,PORT], socket:[HOST:]PORT or usb:[SERIAL]; for example "
    "file:recordings/desk.bag or socket:5555"
)


def open_source(
    text: str, rig: CalibrationOptions, speed: float = 1.0, read: ReadOptions | None = None
) -> Source:
    """The source that a text names, not yet connected.

    Args:
        text: `file:PATH`, `dv:[HOST:]PORT[,PORT]`, `socket:[HOST:]PORT` or `usb:[SERIAL]`.
        rig: calibration of a source without its own.
        speed: of a file: times faster than it was recorded; 0: as fast as possible.
        read: options of reading, for a file.

    Raises:
        LiveError: no such kind of source, or no address; a package is missing.
    """
    kind, colon, rest = text.partition(":")
    if not colon:
        raise LiveError(f"found the source {text!r}; {_EXPECTED}")
    if kind == "file":
        return FileSource(Path(rest), speed, read or ReadOptions())
    if speed != 1.0:
        raise LiveError(f"--speed {speed:g} applies to files only: {kind}: has its own pace; leave it out")
    if kind == "socket":
        return SocketSource(*host_and_port(rest), rig)
    if kind == "dv":
        host, ports = _host_and_rest(rest)
        return DvSource(host, tuple(_port(port, text) for port in ports.split(",")), rig)
    if kind == "usb":
        return UsbSource(rest or None, rig)
    raise LiveError(f"found the source {text!r}; {_EXPECTED}")


def host_and_port(text: str) -> tuple[str, int]:
    """Host and port of `HOST:PORT`, or of `PORT` on this machine. Raises LiveError: no port."""
    host, port = _host_and_rest(text)
    return host, _port(port, text)


def _host_and_rest(text: str) -> tuple[str, str]:
    host, colon, rest = text.rpartition(":")
    return (host.strip("[]") or LOOPBACK, rest) if colon else (LOOPBACK, text)


def _port(text: str, whole: str) -> int:
    if text.isascii() and text.isdigit() and 0 <= int(text) < 2**16:
        return int(text)
    raise LiveError(f"found the port {text!r} in {whole!r}, expected a number up to 65535; {_EXPECTED}")
