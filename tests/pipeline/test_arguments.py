"""Arguments that a program passes by mistake are errors of asyneio, not of what is called inside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import asyneio
from asyneio.errors import ConfigError, EvaluationError, RecordingError
from asyneio.types import PoseTrajectory, Recording
from tests.io.recordings import make_recording


@pytest.fixture
def recording(rng: np.random.Generator) -> Recording:
    return make_recording(rng, seconds=2.0)


def big_endian(rows: np.ndarray) -> np.ndarray:
    return rows.astype(rows.dtype.newbyteorder(">"))


@pytest.mark.parametrize(
    ("part", "change", "said"),
    [
        ("gyroscope", list, "gyroscope: found a list"),
        (
            "accelerometer",
            lambda rows: rows["xyz"],
            "accelerometer: found an array of type float64",
        ),
        ("gyroscope", big_endian, "in native byte order"),
        ("gyroscope", lambda rows: rows[::-1], "timestamps of the gyroscope do not ascend"),
        ("observations", lambda rows: rows.reshape(1, -1), "observations: found an array"),
    ],
)
def test_arrays(recording: Recording, part: str, change: Callable[[Any], Any], said: str) -> None:
    changed = replace(recording, **{part: change(getattr(recording, part))})
    with pytest.raises(RecordingError, match=said):
        asyneio.run(changed)


@pytest.mark.parametrize("wrong", [None, 5, b"desk", ["desk"]])
def test_no_recording(wrong: Any) -> None:
    with pytest.raises(RecordingError, match="expected a Recording, an EventRecording or the path"):
        asyneio.run(wrong)
    with pytest.raises(RecordingError, match="expected the path of a recording"):
        asyneio.open_recording(wrong)


def test_settings_and_output(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="found a dict for the settings"):
        asyneio.run(recording, {"window": 3})  # type: ignore[arg-type]
    (tmp_path / "out").write_text("")
    with pytest.raises(ConfigError, match="is a file; expected a folder"):
        asyneio.run(recording, output=tmp_path / "out")


def poses(**changed: Any) -> PoseTrajectory:
    t_ns = np.arange(50, dtype=np.int64) * 10**7
    whole = PoseTrajectory(
        t_ns, np.outer(t_ns / 1e9, [1.0, 2.0, 3.0]), np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))
    )
    return replace(whole, **changed)


@pytest.mark.parametrize(
    ("estimate", "said"),
    [
        (None, "found a NoneType as the estimate"),
        ([1.0, 2.0], "found a list as the estimate"),
        (poses(t_ns=np.arange(50) * 0.01), "of type float64; expected int64, in nanoseconds"),
        (poses(position=[[0.0, 0.0, 0.0]] * 50), "of type ndarray, list, ndarray; expected numpy arrays"),
    ],
)
def test_estimates(estimate: Any, said: str) -> None:
    with pytest.raises(EvaluationError, match=said):
        asyneio.evaluate(estimate, poses())


def test_ground_truth_and_gap() -> None:
    with pytest.raises(EvaluationError, match="found a dict as the ground truth"):
        asyneio.evaluate(poses(), {})  # type: ignore[arg-type]
    for gap in (-1.0, float("nan")):
        with pytest.raises(EvaluationError, match="max_gap_s is"):
            asyneio.evaluate(poses(), poses(), max_gap_s=gap)
