"""A run that is cut off and resumed gives the result of an uninterrupted one."""

from __future__ import annotations

import os
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config, WindowConfig
from asyneio.errors import AsyneioError, RecordingError
from asyneio.io.parsing.folder_lock import folder_lock
from asyneio.pipeline import CheckpointSettings, RunResult, checkpoint, run_recording
from asyneio.pipeline.fingerprint import _plain
from asyneio.pipeline.safe_pickle import dump, load, view_of
from asyneio.progress import SilentProgress
from asyneio.types import Health, Recording
from tests.odometry.runs import configured, simulated


class Killed(BaseException):
    """Stands for SIGKILL: nothing of the run handles it."""


class KillsAfter(SilentProgress):
    def __init__(self, packets: int) -> None:
        self.left = packets

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        self.left -= 1
        if self.left == 0:
            raise Killed


CONFIGS = {
    **{scheme: configured(inertial={"scheme": scheme}) for scheme in ("gpif", "preint", "extpreint", "gpp")},
    "imu scale": configured(calibration={"estimate_imu_scale": True}),
}


def contents(result: RunResult) -> list[str]:
    """All estimates and reports, without times."""
    reports = [replace(report, seconds=0.0) for report in result.run.reports]
    return [repr(_plain(value)) for value in (*result.run.estimates, *reports)]


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulated(0, duration_s=3.2).recording


@pytest.mark.slow
@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS.keys())
def test_a_resumed_run_gives_the_same_estimates(config: Config, recording: Recording, tmp_path: Path) -> None:
    whole = run_recording(recording, config)
    for packets in (4, 18, 7):
        settings = CheckpointSettings(tmp_path, 1e-9, packets != 4)
        with pytest.raises(Killed):
            run_recording(recording, config, KillsAfter(packets), checkpoints=settings)
    assert checkpoint.has_checkpoint(tmp_path)
    # The newest generation is cut off: the run continues from the one before it.
    states = [tmp_path / name for name in checkpoint.GENERATION_FILES]
    newest = max(states, key=lambda path: path.stat().st_mtime_ns)
    newest.write_bytes(newest.read_bytes()[:1000])
    progress = KillsAfter(0)
    resumed = run_recording(recording, config, progress, checkpoints=CheckpointSettings(tmp_path, 0.0, True))
    assert -progress.left < len(whole.run.reports) - 20
    assert len(whole.run.estimates) > 10
    assert contents(resumed) == contents(whole)


@pytest.mark.slow
def test_a_checkpoint_of_another_run_is_rejected(recording: Recording, tmp_path: Path) -> None:
    settings = CheckpointSettings(tmp_path, 1e-9, False)
    with pytest.raises(Killed):
        run_recording(recording, Config(), KillsAfter(4), checkpoints=settings)
    settings = CheckpointSettings(tmp_path, 1e-9, True)
    assert recording.calibration is not None
    moved = replace(recording.calibration, timeshift_ns=recording.calibration.timeshift_ns + 1)
    samples = recording.gyroscope.copy()
    samples["xyz"][7, 1] += 1e-9
    changed = Config(window=WindowConfig(length_s=1.7))
    cases = (
        (recording, changed, r"setting window\.length_s was 1\.5 and is now 1\.7"),
        (replace(recording, calibration=moved), Config(), "calibration was .* and is now"),
        (replace(recording, gyroscope=samples), Config(), "gyroscope was .* samples .* and is now"),
    )
    for other, config, message in cases:
        with pytest.raises(RecordingError, match=message):
            run_recording(other, config, checkpoints=settings)


def test_slow_checkpoints_are_rare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A checkpoint of 2 s is followed by a pause of 200 s, unless the user sets another one."""
    clock = iter([0.0, 10.0, 12.0, 12.0])
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: next(clock))
    automatic = checkpoint.Checkpoints(CheckpointSettings(tmp_path), {}, print)
    automatic.write(None, None, 0.0)
    assert automatic._due_s == 212.0
    clock = iter([0.0, 10.0, 12.0, 12.0])
    chosen = checkpoint.Checkpoints(CheckpointSettings(tmp_path, 3.0), {}, print)
    chosen.write(None, None, 0.0)
    assert chosen._due_s == 15.0


def test_a_damaged_log_is_rejected(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(Killed):
        run_recording(recording, Config(), KillsAfter(4), checkpoints=CheckpointSettings(tmp_path, 1e-9))
    log = tmp_path / checkpoint.LOG_FILE
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 1
    log.write_bytes(data)
    with pytest.raises(RecordingError, match="is damaged; start the run again without --resume"):
        run_recording(recording, Config(), checkpoints=CheckpointSettings(tmp_path, 1e-9, True))


class Evil:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("true",)


@pytest.mark.parametrize(
    "data",
    [
        pickle.dumps(Evil()),
        pickle.dumps(np.array([Evil()], dtype=object)),
        b"casyneio.pipeline.checkpoint\nremove_checkpoints\n.",
        b"casyneio.config\nload_config\n.",
        b"casyneio.odometry.odometry\nnp.load\n.",
        b"cnumpy\nload\n.",
        b"\x80",
    ],
)
def test_a_state_that_calls_functions_is_rejected(data: bytes) -> None:
    with pytest.raises(AsyneioError, match="state of a run"):
        load(data)


def test_a_folder_belongs_to_one_run(tmp_path: Path) -> None:
    (tmp_path / ".asyneio.lock").write_text("1\n")  # left behind by a killed run
    with (
        folder_lock(tmp_path),
        pytest.raises(RecordingError, match=f"process {os.getpid()}"),
        folder_lock(tmp_path),
    ):
        pass
    assert list(tmp_path.iterdir()) == []


def test_arrays_that_share_memory_share_it_after_loading() -> None:
    ring = np.arange(24.0).reshape(4, 6)
    columns = np.asfortranarray(ring)
    views = [ring[1:3], ring[:, 2:5], ring[::-1, ::2], ring.T, columns[1:, :2], columns.T]
    restored, *loaded = load(dump([ring, *views]))
    for found, view in zip(loaded, views, strict=True):
        assert (found.strides, found.flags.c_contiguous) == (view.strides, view.flags.c_contiguous)
        np.testing.assert_array_equal(found, view)
    ring[2, 4] = restored[2, 4] = -1.0
    for found, view in zip(loaded, views, strict=True):
        np.testing.assert_array_equal(found, view)
    assert not np.may_share_memory(restored, ring)


def test_a_small_slice_of_a_large_array_is_stored_as_a_copy() -> None:
    recording = np.zeros(2**21)
    assert len(dump(recording[7:9])) < 1000


def test_a_view_outside_its_array_is_rejected() -> None:
    with pytest.raises((ValueError, TypeError)):
        view_of(np.arange(4.0), 16, (4,), np.dtype(float), (8,))
    with pytest.raises((ValueError, TypeError)):
        view_of(np.arange(4.0), -8, (2,), np.dtype(float), (8,))
