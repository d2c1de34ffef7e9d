# SPDX-License-Identifier: Apache-2.0
"""Zipped recordings of the UZH event camera data set, as they are downloaded."""

from __future__ import annotations

from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.calibration import (
    CAMCHAIN_FILE,
    IMU_FILE,
    CalibrationSources,
    find_calibration,
    parse_calibration,
    sources_of,
)
from asyneio.io.parsing.zip_member import ZipMember, open_zip
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.sidecar import find_samples
from asyneio.io.text.reader import TextEvents
from asyneio.io.uzh.folder_reader import EVENTS_FILE, SAMPLES_FILE, uzh_contents, uzh_samples

_MAX_LISTED = 8


def read_uzh_zip(path: Path, options: ReadOptions) -> Contents:
    """A zip with `events.txt` and other files of a UZH folder, in its root or in a folder.

    Without inertial samples or a calibration inside, those next to the archive are used.

    Args:
        path: the archive.
        options: the user's choices; `events` names the folder with the events, if there are several.

    Raises:
        RecordingError: damaged, encrypted, hostile, without events or with several recordings.
        CalibrationError: a calibration file is malformed or impossible.
    """
    member = _choose(path, options.events)
    folder = member.rpartition("/")[0]

    def file(name: str) -> ZipMember:
        """A file in the folder of the events."""
        return ZipMember(path, f"{folder}/{name}" if folder else name)

    calibration = find_calibration(path.parent, options.calibration, options.imu)
    if options.calibration is None and (calibration.file is None or calibration.found_by_content):
        calibration = _calibration_inside(file(CAMCHAIN_FILE), file(IMU_FILE)) or calibration
    events = ZipMember(path, member)
    name = folder.rsplit("/", 1)[-1] or path.resolve().stem
    samples = uzh_samples(file(SAMPLES_FILE)) or find_samples(path.parent, options)
    return uzh_contents(name, lambda: TextEvents(path, events), calibration, file, samples, variant=member)


def _choose(path: Path, selected: str | None) -> str:
    """The member with the events."""
    with open_zip(path) as archive:
        names = [name for name in archive.namelist() if not name.startswith("__MACOSX/")]
    found = [name for name in names if name.rsplit("/", 1)[-1] == EVENTS_FILE]
    if selected is not None:
        named = [name for name in found if selected.strip("/") in (name, name.rpartition("/")[0])]
        if not named:
            raise RecordingError(f"{path} has no events in {selected}; available: {_listed(found)}")
        return named[0]
    if not found:
        raise RecordingError(
            f"{path} is a zip without {EVENTS_FILE}; it contains {_listed(names)}; only archives of the UZH "
            "data set (text) are read directly: unpack this one"
        )
    if len(found) > 1:
        raise RecordingError(
            f"{path} contains {len(found)} recordings: {_listed(found)}; select one with --events FOLDER"
        )
    return found[0]


def _calibration_inside(camchain: ZipMember, imu: ZipMember) -> CalibrationSources | None:
    """Kalibr's files in the archive, if it has any."""
    if not camchain.is_file():
        return None
    files = [
        parse_calibration(file.read_text(errors="replace"), file.archive / file.member)
        for file in (camchain, imu)
        if file.is_file()
    ]
    return sources_of(files[0], files[1] if len(files) > 1 else None)


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return (", ".join(names[:_MAX_LISTED]) or "nothing") + more
