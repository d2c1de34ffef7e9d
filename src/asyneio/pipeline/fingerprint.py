"""Fingerprint of a run: what must be the same for a checkpoint to continue it."""

from __future__ import annotations

import hashlib
import platform
from pathlib import Path

import numba
import numpy as np

from asyneio.config import Config
from asyneio.errors import RecordingError
from asyneio.pipeline.safe_pickle import dump
from asyneio.types import EventRecording, RecordArray, Recording
from asyneio.version import __version__

#: Version of the checkpoint files.
_FORMAT = 1
#: Events that are hashed at each end of a recording: all of them would take seconds.
_END_EVENTS = 65_536


def fingerprint_of(recording: Recording | EventRecording, config: Config) -> dict[str, str]:
    """Names and values: format, versions, source of the package, every setting, recording, calibration."""
    settings = {
        f"setting {section}.{name}": repr(value)
        for section, values in config.model_dump().items()
        for name, value in (values.items() if isinstance(values, dict) else [("", values)])
    }
    return {
        "format": str(_FORMAT),
        "version of asyneio": __version__,
        "source code of asyneio": _source_hash(),
        "versions": f"python {platform.python_version()}, numpy {np.__version__}, numba {numba.__version__}",
        **settings,
        **_recording_fields(recording),
        "calibration": _hash(dump(recording.calibration)),
    }


def check_fingerprint(found: dict[str, str], expected: dict[str, str], folder: Path) -> None:
    """Raises RecordingError: they differ; the message states where."""
    names = [name for name in {**expected, **found} if found.get(name) != expected.get(name)]
    if not names:
        return
    differences = "; ".join(
        f"{name} was {found.get(name, 'absent')} and is now {expected.get(name, 'absent')}"
        for name in names[:5]
    )
    more = f"; and {len(names) - 5} more" if len(names) > 5 else ""
    raise RecordingError(
        f"the checkpoint in {folder} belongs to another run: {differences}{more}. Restore what has changed, "
        "or start the run again without --resume"
    )


def _recording_fields(recording: Recording | EventRecording) -> dict[str, str]:
    tracks = isinstance(recording, Recording)
    stream = recording.observations if isinstance(recording, Recording) else recording.events
    fields = {
        "recording": recording.name,
        f"number of {'observations' if tracks else 'events'}": str(stream.size),
        "first and last observations" if tracks else "first and last events": _ends_hash(stream),
    }
    for name in ("gyroscope", "accelerometer"):
        samples: RecordArray = getattr(recording, name)
        fields[f"{name} samples"] = f"{samples.size} ({_hash(np.ascontiguousarray(samples).tobytes())})"
    return fields


def _ends_hash(stream: RecordArray) -> str:
    ends = (stream[:_END_EVENTS], stream[-_END_EVENTS:])
    return _hash(b"".join(np.ascontiguousarray(end).tobytes() for end in ends))


def _source_hash() -> str:
    root = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
