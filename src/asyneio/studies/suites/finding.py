# SPDX-License-Identifier: Apache-2.0
"""Recordings of a data set in a folder, and the files that belong to each."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from asyneio.errors import SimulationError, StudyError
from asyneio.simulation.scenarios import scenario_named
from asyneio.studies.suites.data_set import DataSet, PerSequence

#: Files up to this size are identified by their contents, larger ones by size and modification time.
_MAX_HASHED = 2**20


@dataclass(frozen=True)
class Given:
    """Files that the user names instead of those of the data set."""

    calibration: Path | None = None
    imu: Path | None = None


@dataclass(frozen=True)
class Found:
    """A recording and its files, as absolute paths; empty where there is none.

    `identity`: hash of what identifies the contents of all of them. For a simulation, `source` is the name of
    its scenario.
    """

    sequence: str
    source: str
    identity: str = ""
    calibration: str = ""
    imu: str = ""
    truth: str = ""
    samples: str = ""
    markers: tuple[str, ...] = ()


def find_recordings(
    suite: DataSet, folder: Path | None, names: Sequence[str] = (), given: Given | None = None
) -> tuple[Found, ...]:
    """Recordings in a folder or its subfolders.

    Args:
        suite: the data set.
        folder: folder to search; None for simulated recordings.
        names: names of sequences; empty: those of the suite that exist.
        given: files that the user names.

    Raises:
        StudyError: the folder does not exist, sequences are missing or unknown, or a file cannot be read.
    """
    if suite.simulated:
        return tuple(_scenario(name) for name in names or suite.sequences)
    if folder is None or not folder.is_dir():
        raise StudyError(f"{folder} is not a folder; expected the folder that contains the sequences")
    found = {
        name: place for name in names or suite.sequences if (place := _place(suite, folder, name)) is not None
    }
    missing = [name for name in names if name not in found]
    if missing or not found:
        what = f"no sequence {', '.join(missing)}" if missing else f"no sequence of {suite.title}"
        example = suite.sequences[0]
        expected = " or ".join(
            dict.fromkeys((place.content or place.source).format(name=example) for place in suite.locations)
        )
        raise StudyError(
            f"{what} in {folder}; expected files such as {expected}, with the data set's names: "
            f"{', '.join(suite.sequences)}"
        )
    return tuple(_with_files(suite, folder, name, place, given or Given()) for name, place in found.items())


@dataclass(frozen=True)
class _Place:
    """A recording: the folder in which its pattern matched, its path, and the file that identifies it."""

    base: Path
    source: Path
    content: Path


def _scenario(name: str) -> Found:
    try:
        scenario_named(name)
    except SimulationError as error:
        raise StudyError(str(error)) from error
    return Found(name, name)


def _place(suite: DataSet, folder: Path, name: str) -> _Place | None:
    """Where a sequence is: in this folder, else in a subfolder."""
    for base in (folder, *sorted(path for path in folder.iterdir() if path.is_dir())):
        for location in suite.locations:
            content = base / (location.content or location.source).format(name=name)
            if content.is_file():
                return _Place(base, base / location.source.format(name=name), content)
    return None


def _with_files(suite: DataSet, folder: Path, name: str, place: _Place, given: Given) -> Found:
    bases = tuple(dict.fromkeys((place.base, place.source.parent, folder)))

    def first(files: PerSequence) -> Path | None:
        return next((path for file in files.of(name) if (path := _file(bases, file)) is not None), None)

    markers = tuple(path for file in suite.markers.of(name) if (path := _file(bases, file)) is not None)
    chosen = (
        given.calibration or first(suite.calibration),
        given.imu or first(suite.imu),
        first(suite.truth),
        first(suite.samples),
    )
    identity = _identity([path for path in (place.content, *chosen, *markers) if path is not None])
    calibration, imu, truth, samples = (str(path.resolve()) if path else "" for path in chosen)
    paths = tuple(str(path.resolve()) for path in markers)
    return Found(name, str(place.source.resolve()), identity, calibration, imu, truth, samples, paths)


def _file(bases: Sequence[Path], name: str) -> Path | None:
    return next((base / name for base in bases if (base / name).is_file()), None)


def _identity(paths: Sequence[Path]) -> str:
    """Hash of the contents of small files, and of the sizes and modification times of large ones."""
    digest = hashlib.sha256()
    for path in paths:
        try:
            status = path.stat()
            small = status.st_size <= _MAX_HASHED
            content = path.read_bytes() if small else f"{status.st_size} {status.st_mtime_ns}".encode()
        except OSError as error:
            raise StudyError(f"cannot read {path}: {error.strerror or error}") from error
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()[:16]
