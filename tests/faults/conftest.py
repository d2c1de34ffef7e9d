"""A simulated recording as files, into which the tests inject faults, and the commands that a user runs."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asyneio.config import dump_config
from asyneio.io import write_tracks_folder
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.simulation import Simulation
from tests.cli.conftest import Asyneio
from tests.cli.conftest import asyneio as asyneio
from tests.cli.fakes import FakeOdometry
from tests.odometry.runs import configured, simulated

RATE_HZ = 200.0
SAMPLES_HEADER = "t_ns,gx,gy,gz,ax,ay,az"


@pytest.fixture(scope="session")
def simulation() -> Simulation:
    """Four seconds of a hand-held camera with tracks, and an IMU with one clock for both sensors."""
    return simulated(0, accelerometer_rate_hz=RATE_HZ, accelerometer_offset_s=0.0)


@pytest.fixture(scope="session")
def intact(simulation: Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its tracks folder; must not be changed."""
    folder = tmp_path_factory.mktemp("faults") / "desk"
    write_tracks_folder(simulation.recording, folder)
    (folder.parent / "settings.yaml").write_text(dump_config(configured()))
    return folder


@pytest.fixture
def desk(intact: Path, tmp_path: Path) -> Path:
    """A copy of the folder, for faults."""
    return Path(shutil.copytree(intact, tmp_path / "desk"))


@dataclass(frozen=True)
class Ran:
    """What `asyneio run` left: exit status, messages, files."""

    status: int
    said: str
    folder: Path
    printed: dict[str, Any]

    @property
    def summary(self) -> dict[str, Any]:
        return dict(json.loads((self.folder / "summary.json").read_text()))

    @property
    def states(self) -> list[dict[str, str]]:
        """The rows of health.csv."""
        with (self.folder / "health.csv").open() as stream:
            return list(csv.DictReader(stream))

    @property
    def poses(self) -> np.ndarray:
        """The rows of trajectory.tum."""
        return np.loadtxt(self.folder / "trajectory.tum")

    def reasons(self, health: str) -> set[str]:
        return {row["reason"] for row in self.states if row["health"] == health}

    def error_m(self) -> float:
        """Root mean square of the position error, position and yaw aligned."""
        return float(self.printed["evaluation"][0]["position_m"]["rmse"])

    def scale_error(self) -> float:
        return 1e-2 * float(self.printed["evaluation"][0]["scale_error_percent"])


Run = Callable[..., Ran]


@pytest.fixture
def run(asyneio: Asyneio, intact: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """`asyneio run FOLDER`, without the report, whose figures take seconds."""
    monkeypatch.setattr("asyneio.cli.execute.available", lambda: False)

    def call(folder: Path, *options: str, into: str = "out") -> Ran:
        settings = intact.parent / "settings.yaml"
        place = tmp_path / into
        status, out, said = asyneio("run", folder, "-o", place, "--config", settings, "--json", *options)
        return Ran(status, said, place, json.loads(out) if out else {})

    return call


@pytest.fixture
def read(run: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Like `run`, with an estimator that takes no time: for what the readers decide."""
    monkeypatch.setattr(pipeline, "Odometry", FakeOdometry)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    return run


def change_samples(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Rows of t_ns, three rates, three accelerations; the time is relative to the first sample [ns]."""
    path = folder / "imu.csv"
    stamps = np.loadtxt(path, delimiter=",", skiprows=1, usecols=0, dtype=np.int64)
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    rows[:, 0] = stamps - stamps[0]
    write_samples(path, change(rows), int(stamps[0]))


def write_samples(path: Path, rows: np.ndarray, first_ns: int, header: str = SAMPLES_HEADER) -> None:
    lines = [f"{first_ns + round(row[0])}," + ",".join(map(repr, row[1:].tolist())) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n")
