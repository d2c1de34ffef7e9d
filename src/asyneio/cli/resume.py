"""`asyneio run` with checkpoints: one run per folder, its options on record, continued with `--resume`."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import FrameType

from asyneio.cli import console
from asyneio.cli.execute import Job, execute
from asyneio.cli.options import SchemeName, TrackerName, settings_of, with_scheme, with_tracker
from asyneio.cli.progress import reading_progress
from asyneio.errors import EstimationError, RecordingError
from asyneio.io import ReadOptions, open_recording
from asyneio.io.parsing.atomic import make_folder, remove_empty, write_text
from asyneio.io.parsing.folder_lock import folder_lock
from asyneio.pipeline import SUMMARY_FILE, CheckpointSettings
from asyneio.pipeline.checkpoint import has_checkpoint, remove_checkpoints

#: Folder of checkpoints and options in the results folder; removed when the run is complete.
RUN_FOLDER = ".run"
OPTIONS_FILE = "options.json"
_PATHS = ("recording", "calibration", "imu", "config")


@dataclass(frozen=True)
class Arguments:
    """Arguments and options of `asyneio run` that the results depend on, named as on the command line."""

    recording: Path
    calibration: Path | None = None
    imu: Path | None = None
    camera: str | None = None
    preset: str | None = None
    events: str | None = None
    samples: str | None = None
    config: Path | None = None
    tracker: str | None = None
    scheme: str | None = None
    max_track_seconds: float | None = None
    png: bool = False
    checkpoint_every: float = 10.0

    def to_json(self) -> str:
        """JSON text, with absolute paths."""
        values = asdict(self)
        for name in _PATHS:
            values[name] = values[name] and str(values[name].resolve())
        return json.dumps(values, indent=2) + "\n"


def arguments_in(folder: Path) -> Arguments | None:
    """Arguments of the interrupted run in a results folder; None if the run there is complete.

    Raises:
        RecordingError: the folder contains no run, or its options are damaged.
    """
    path = folder / RUN_FOLDER / OPTIONS_FILE
    if not path.is_file():
        if (folder / SUMMARY_FILE).is_file():
            console.say(f"the run in {folder} has ended: nothing to resume")
            return None
        raise RecordingError(
            f"{folder} contains no interrupted run ({RUN_FOLDER}/{OPTIONS_FILE} is missing); start it with "
            f"`asyneio run RECORDING -o {folder}`"
        )
    names = {field.name for field in fields(Arguments)}
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        if set(values) != names:
            raise ValueError(f"found the options {sorted(values)}, expected {sorted(names)}")
        return Arguments(**{k: Path(v) if k in _PATHS and v else v for k, v in values.items()})
    except (OSError, ValueError, TypeError) as error:
        raise RecordingError(f"cannot read {path}: {error}; start the run again without --resume") from error


def run_with_checkpoints(arguments: Arguments, output: Path | None, as_json: bool, resume: bool) -> None:
    """Read a recording, run it and write the results; on success, remove the checkpoints.

    Raises:
        EstimationError, RecordingError: as `execute`; another run uses the folder.
    """
    settings = settings_of(arguments.config, arguments.preset)
    settings = with_tracker(settings, TrackerName(arguments.tracker) if arguments.tracker else None)
    settings = with_scheme(settings, SchemeName(arguments.scheme) if arguments.scheme else None)
    options = ReadOptions(
        arguments.calibration,
        arguments.imu,
        arguments.events,
        arguments.samples,
        arguments.camera,
        arguments.preset,
    )
    with reading_progress(arguments.recording) as progress:
        loaded = open_recording(arguments.recording, options, progress, arguments.max_track_seconds)
    for note in loaded.notes:
        console.say(f"note: {note}")
    folder = output or Path("results") / loaded.name
    state = folder / RUN_FOLDER
    checkpoints = CheckpointSettings(state, arguments.checkpoint_every, resume)
    with _exclusive(folder), _terminable():
        if not resume:
            remove_checkpoints(state)
            write_text(state / OPTIONS_FILE, arguments.to_json())
        job = Job(loaded, settings, folder, png=arguments.png, as_json=as_json, checkpoints=checkpoints)
        try:
            execute(job)
        except EstimationError:
            # The estimator ended the run; running the rest again gives the same.
            _remove(state)
            raise
        except BaseException:
            if not has_checkpoint(state):
                _remove(state)
            raise
        _remove(state)


@contextmanager
def _exclusive(folder: Path) -> Iterator[None]:
    """Create a folder and lock it; afterwards, remove it if it is empty."""
    make_folder(folder)
    try:
        with folder_lock(folder):
            yield
    finally:
        remove_empty(folder)


@contextmanager
def _terminable() -> Iterator[None]:
    """Inside the block, SIGTERM ends the run like Ctrl-C."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not in the main thread: signals are handled elsewhere
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _remove(state: Path) -> None:
    """Remove checkpoints and options; without effect where the disk does not permit it."""
    with suppress(OSError):
        remove_checkpoints(state)
        (state / OPTIONS_FILE).unlink(missing_ok=True)
        for part in state.glob(f".{OPTIONS_FILE}.*"):
            part.unlink(missing_ok=True)
        state.rmdir()
