# SPDX-License-Identifier: Apache-2.0
"""Fingerprint of a run: what must be the same for a checkpoint to continue it."""

from __future__ import annotations

import platform
from dataclasses import fields, is_dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numba
import numpy as np
import scipy

from asyneio.config import Config
from asyneio.errors import RecordingError
from asyneio.types import EventRecording, RecordArray, Recording
from asyneio.version import __version__

#: Version of the checkpoint files.
_FORMAT = 1
#: Blocks of events that are hashed, evenly over a recording with both ends: all events would take seconds.
_BLOCKS, _BLOCK_EVENTS = 64, 4096
#: Differences that an error names.
_NAMED = 5


def fingerprint_of(recording: Recording | EventRecording, config: Config) -> dict[str, str]:
    """Names and values: format, versions, source of the package, every setting, recording, calibration."""
    settings = {
        f"setting {section}.{name}": repr(value)
        for section, values in config.model_dump().items()
        for name, value in (values.items() if isinstance(values, dict) else [("", values)])
    }
    versions = {"python": platform.python_version()}
    versions |= {module.__name__: module.__version__ for module in (np, scipy, numba)}
    return {
        "format": str(_FORMAT),
        "version of asyneio": __version__,
        "source code of asyneio": _source_digest(),
        "versions": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "processor": platform.machine(),
        **settings,
        **_recording_fields(recording),
        "calibration": _digest(repr(_plain(recording.calibration)).encode()),
    }


def check_fingerprint(found: dict[str, str], expected: dict[str, str], folder: Path) -> None:
    """Raises RecordingError: they differ; the message states where."""
    names = [name for name in {**expected, **found} if found.get(name) != expected.get(name)]
    if not names:
        return
    differences = "; ".join(
        f"{name} was {found.get(name, 'absent')} and is now {expected.get(name, 'absent')}"
        for name in names[:_NAMED]
    )
    more = f"; and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    raise RecordingError(
        f"the checkpoint in {folder} belongs to another run: {differences}{more}. Restore what has changed, "
        "or start the run again without --resume"
    )


def _recording_fields(recording: Recording | EventRecording) -> dict[str, str]:
    tracks = isinstance(recording, Recording)
    stream = recording.observations if isinstance(recording, Recording) else recording.events
    return {
        "recording": recording.name,
        "observations" if tracks else "events": f"{stream.size} ({_sampled_digest(stream)})",
        "gyroscope": _samples(recording.gyroscope),
        "accelerometer": _samples(recording.accelerometer),
    }


def _samples(samples: RecordArray) -> str:
    return f"{samples.size} samples ({_digest(samples.tobytes())})"


def _sampled_digest(stream: RecordArray) -> str:
    starts = np.linspace(0, max(stream.size - _BLOCK_EVENTS, 0), _BLOCKS).astype(np.int64).tolist()
    return _digest(b"".join(stream[start : start + _BLOCK_EVENTS].tobytes() for start in starts))


def _source_digest() -> str:
    root = Path(__file__).resolve().parent.parent
    paths = sorted(root.rglob("*.py"))
    named = (path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() for path in paths)
    return _digest(b"\0".join(named))


def _plain(value: Any) -> Any:
    """A value whose `repr` shows all of it."""
    if is_dataclass(value):
        return {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
    return value.tolist() if isinstance(value, np.ndarray) else value


def _digest(data: bytes) -> str:
    return blake2b(data, digest_size=8).hexdigest()
