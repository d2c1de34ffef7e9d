"""`asyneio bench uzh` on a small data set of the same layout: complete, resumed, failing in part; and
`asyneio bench speed` with an estimator that takes no time."""

from __future__ import annotations

import json
import pickle
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.cameras import PRESETS
from asyneio.config import Config
from asyneio.errors import StudyError
from asyneio.io import write_events_hdf5, write_uzh_folder
from asyneio.io.ros.ros1_writer import write_rosbag
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.studies import speed, speed_report
from asyneio.studies.excerpts import first_seconds
from asyneio.studies.speed_run import SpeedRun
from asyneio.studies.speed_workload import Workload
from asyneio.studies.suites import measure
from asyneio.studies.suites.finding import Found, Given, find_recordings
from asyneio.studies.suites.jobs import BenchSettings, BenchTask, Grid, jobs
from asyneio.studies.suites.measure import measure_job, moved
from asyneio.studies.suites.uzh import COMPARED, UZH
from asyneio.types import EventRecording, PoseTrajectory
from tests.cli.conftest import Asyneio
from tests.cli.fakes import FakeOdometry, NeverStarts
from tests.io.event_recordings import make_event_recording, make_events
from tests.io.recordings import START_NS, make_calibration, make_estimate, make_stream, straight_path

_SECONDS = 4.0


@pytest.fixture
def asyneio(asyneio: Asyneio, monkeypatch: pytest.MonkeyPatch) -> Asyneio:
    """Use an estimator with an error of a millimetre."""
    monkeypatch.setattr(pipeline, "Odometry", FakeOdometry)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    return asyneio


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    """Four seconds; ground truth is the camera pose in the camera clock; no extrinsics and no IMU noise."""
    rng = np.random.default_rng(7)
    preset, body = PRESETS["DAVIS240C"], straight_path(_SECONDS)
    assert preset.T_b_c is not None
    assert preset.timeshift_ns is not None
    R_w_b = Rotation.from_quat(body.quaternion)
    camera = PoseTrajectory(
        body.t_ns - preset.timeshift_ns,
        body.position + R_w_b.apply(preset.T_b_c[:3, 3]),
        (R_w_b * Rotation.from_matrix(preset.T_b_c[:3, :3])).as_quat(),
    )
    return replace(
        make_event_recording(rng),
        events=make_events(rng, 3000, _SECONDS),
        gyroscope=make_stream(rng, 200.0, _SECONDS, [0.1, 0.0, -0.2]),
        accelerometer=make_stream(rng, 200.0, _SECONDS, [0.0, 0.0, 9.81]),
        calibration=None,
        ground_truth=camera,
    )


def write_sequence(recording: EventRecording, folder: Path) -> Path:
    """The layout of the data set: events.txt, imu.txt, groundtruth.txt, calib.txt."""
    write_uzh_folder(recording, folder)
    (folder / "camchain-imucam.yaml").unlink()
    return folder


@pytest.fixture
def data(tmp_path: Path, recording: EventRecording) -> Path:
    """One sequence at the top level, another in a subfolder."""
    write_sequence(recording, tmp_path / "data" / "boxes_6dof")
    write_sequence(recording, tmp_path / "data" / "hdr" / "hdr_poster")
    return tmp_path / "data"


def results(folder: Path) -> dict[str, Any]:
    """Figures by sequence."""
    found = json.loads((folder / "results.json").read_text())
    return {result["sequence"]: result for result in found["results"]}


@pytest.mark.slow
def test_end_to_end(asyneio: Asyneio, data: Path, tmp_path: Path) -> None:
    status, out, err = asyneio("bench", "uzh", data, "-o", tmp_path / "out")
    assert status == 0, err
    assert "| boxes_6dof | 3.9" in out
    assert "| mean of 2 |" in out
    assert "| Mono-EIO 2022 | E+I | hku | 0.61 | 0.4 | 0.505 |" in out
    assert (tmp_path / "out" / "README.md").read_text().rstrip() == out.rstrip()
    found = results(tmp_path / "out")
    assert set(found) == {"boxes_6dof", "hdr_poster"}
    for measured in found.values():
        # An error of a millimetre on a path of two metres.
        assert 0.02 < measured["mpe_percent_posyaw"] < 0.2
        assert measured["path_m"] == pytest.approx(1.8, abs=0.2)
        assert None not in measured.values()


def test_estimates_are_moved_into_the_camera() -> None:
    """Position and attitude by multiplication; the velocity is that of differences of the position."""
    calibration = make_calibration()
    step_ns = 10**6
    estimates = [make_estimate(START_NS + k * step_ns) for k in range(5)]
    found = moved(estimates, calibration.T_b_c, calibration.timeshift_ns)
    for k, estimate in enumerate(estimates):
        T_w_c = estimate.T_w_b @ calibration.T_b_c
        np.testing.assert_allclose(found.poses.position[k], T_w_c[:3, 3], atol=1e-15)
        R = Rotation.from_quat(found.poses.quaternion[k]).as_matrix()
        np.testing.assert_allclose(R, T_w_c[:3, :3], atol=1e-12)
    # t_imu = t_cam + timeshift.
    assert found.poses.t_ns[0] == START_NS - calibration.timeshift_ns
    velocity_w = (found.poses.position[2] - found.poses.position[0]) / (2e-9 * step_ns)
    in_camera = Rotation.from_quat(found.poses.quaternion[1]).inv().apply(velocity_w)
    # The lever arm contributes: without it the velocity would be off by a centimetre per second.
    np.testing.assert_allclose(found.velocity_b[1], in_camera, atol=1e-6)


@pytest.mark.slow
def test_it_goes_on_where_it_stopped(
    asyneio: Asyneio, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ("bench", "uzh", data, "-o", tmp_path / "out")
    assert asyneio(*command, "--sequences", "boxes_6dof")[0] == 0
    first = results(tmp_path / "out")
    measured: list[str] = []

    def watched(task: BenchTask, settings: BenchSettings) -> dict[str, float]:
        measured.append(task.sequence)
        return measure_job(task, settings)

    monkeypatch.setattr(measure, "measure_job", watched)
    status, _, err = asyneio(*command)
    assert (status, measured) == (0, ["hdr_poster"])
    assert "note: 1 result(s) of an earlier run were reused" in err
    assert results(tmp_path / "out")["boxes_6dof"] == first["boxes_6dof"]
    settings = tmp_path / "settings.yaml"
    settings.write_text("visual: {pixel_sigma: 0.7}\n")
    assert asyneio(*command, "--config", settings)[0] == 0
    assert asyneio(*command, "--seconds", "2")[0] == 0
    assert asyneio(*command)[0] == 0
    assert measured == ["hdr_poster"] + 2 * ["boxes_6dof", "hdr_poster"]


def test_a_short_part_does_not_pass_for_the_whole(asyneio: Asyneio, data: Path, tmp_path: Path) -> None:
    status, out, _ = asyneio("bench", "uzh", data, "-o", tmp_path / "out", "--seconds", "2")
    assert status == 0
    assert "Ours are over the first 2 s of each sequence, theirs over all of it: not comparable." in out
    found = results(tmp_path / "out")["boxes_6dof"]
    assert found["duration_s"] == pytest.approx(1.9, abs=0.15)
    # Two seconds contain no pose of the seconds 3-8, to which SE(3) is fitted.
    assert found["mpe_percent_uslam"] is None
    assert found["mpe_percent_hku"] is not None


@pytest.mark.slow
def test_a_sequence_that_fails_is_listed(
    asyneio: Asyneio, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (data / "hdr" / "hdr_poster" / "groundtruth.txt").unlink()
    command = ("bench", "uzh", data, "-o", tmp_path / "out")
    status, out, err = asyneio(*command)
    assert status == 1
    assert "| hdr_poster | failed |" in out
    assert "- hdr_poster: EvaluationError: " in out
    assert "asyneio: 1 of 2 jobs failed: hdr_poster: EvaluationError: " in err
    assert "has no ground truth" in err
    assert "| mean of 1 |" in out
    monkeypatch.setattr(pipeline, "Odometry", NeverStarts)
    status, out, err = asyneio(*command, "--preset", "", "--json")
    assert status == 1
    failures = {found["sequence"]: found["failure"] for found in json.loads(out)["results"]}
    assert "no complete calibration" in failures["boxes_6dof"]
    status, out, _ = asyneio(*command, "--sequences", "boxes_6dof", "--seconds", "2")
    assert status == 1
    assert "the estimator did not initialize" in out


def _zipped(recording: EventRecording, path: Path) -> None:
    folder = write_sequence(recording, path.parent / "unpacked" / "in" / path.stem)
    with zipfile.ZipFile(path.with_suffix(".zip"), "w") as packed:
        for file in folder.iterdir():
            packed.write(file, file.name)


def _bagged(recording: EventRecording, path: Path) -> None:
    write_rosbag(recording, path.with_suffix(".bag"))


@pytest.mark.slow
@pytest.mark.parametrize("write", [_zipped, _bagged])
def test_archives_and_bags(
    asyneio: Asyneio,
    tmp_path: Path,
    recording: EventRecording,
    write: Callable[[EventRecording, Path], None],
) -> None:
    write_sequence(recording, tmp_path / "folders" / "poster_6dof")
    (tmp_path / "packed").mkdir()
    write(recording, tmp_path / "packed" / "poster_6dof")
    figures = []
    for data in ("folders", "packed"):
        status, out, err = asyneio("bench", "uzh", tmp_path / data, "-o", tmp_path / "out", "--json")
        assert status == 0, err
        (found,) = json.loads(out)["results"]
        figures.append({name: value for name, value in found.items() if isinstance(value, float)})
        for name in ("processing_s", "real_time_factor"):
            del figures[-1][name]
    assert figures[0] == pytest.approx(figures[1])


def test_what_is_found(tmp_path: Path) -> None:
    def touch(path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()

    for name in (
        "boxes_6dof.zip", "boxes_6dof.bag", "sub/poster_6dof.zip", "poster_6dof/notes.txt",
        "hdr_boxes.bag", "hdr_boxes/events.txt", "shapes_rotation/events.txt", "other.bag",
    ):  # fmt: skip
        touch(tmp_path / name)
    found = {place.sequence: Path(place.source).name for place in find_recordings(UZH, tmp_path)}
    assert found == {
        "boxes_6dof": "boxes_6dof.bag",
        "hdr_boxes": "hdr_boxes",
        "poster_6dof": "poster_6dof.zip",
    }
    named = jobs(UZH, find_recordings(UZH, tmp_path, ("shapes_rotation",)), Grid(seconds=5.0))
    assert [(task.sequence, task.seconds) for task in named] == [("shapes_rotation", 5.0)]
    with pytest.raises(StudyError, match="no sequence urban, walk in"):
        find_recordings(UZH, tmp_path, ("urban", "boxes_6dof", "walk"))
    with pytest.raises(StudyError, match=r"no sequence of UZH .*such as boxes_translation/events.txt or"):
        find_recordings(UZH, tmp_path / "hdr_boxes")
    with pytest.raises(StudyError, match="is not a folder"):
        find_recordings(UZH, tmp_path / "absent")


def test_first_seconds(recording: EventRecording) -> None:
    part = first_seconds(recording, 2.0)
    start_ns = recording.events["t_ns"][0]
    assert part.events["t_ns"][-1] <= start_ns + 2 * 10**9 < recording.events["t_ns"][part.events.size]
    assert part.gyroscope["t_ns"][-1] <= start_ns + 2 * 10**9
    assert part.ground_truth is recording.ground_truth


def test_work_can_be_sent_to_another_process(data: Path) -> None:
    task = jobs(UZH, find_recordings(UZH, data), Grid())[0]
    work: Callable[[BenchTask], dict[str, float]] = partial(
        measure_job, settings=BenchSettings("uzh", Config(), "DAVIS240C")
    )
    assert pickle.loads(pickle.dumps((work.func, task))) == (measure_job, task)


def test_contents_of_files_identify_a_job(data: Path, tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("a: 1\n")

    def found() -> Found:
        return find_recordings(UZH, data, ("boxes_6dof",), Given(path))[0]

    before = found()
    assert before == found()
    assert before.calibration == str(path)
    path.write_text("a: 2\n")
    assert found().identity != before.identity
    path.unlink()
    with pytest.raises(StudyError, match="cannot read"):
        found()


def test_published_means() -> None:
    """Published means, as a check of the published figures."""
    means = (2.58, 0.69, 0.47, 0.81, 1.45, 0.54, 1.58, 0.39, 0.35, 0.24, 0.21, 0.21, 0.06)
    for method, mean in zip(UZH.published, means, strict=True):
        assert tuple(method.results) == COMPARED
        assert np.mean(list(method.results.values())) == pytest.approx(mean, abs=0.0051), method.method


@contextmanager
def _here(workload: Workload, **_: str) -> Iterator[speed.Measure]:
    """Measure in this process, with the fake estimator."""
    run = SpeedRun(workload)
    yield lambda name, *arguments: getattr(run, name)(*arguments)


@pytest.mark.slow
def test_speed(
    asyneio: Asyneio, recording: EventRecording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(speed, "_process", _here)
    write_events_hdf5(make_event_recording(np.random.default_rng(7)), tmp_path / "own.h5")
    baseline = tmp_path / "baseline.json"
    other = {"relative": {name: 1.0 for name in speed.TIMED}, "scheme": "gpif"}
    other |= {"relative_cpu": other["relative"], "workload": {"name": "other", "width": 240, "height": 180}}
    baseline.write_text(json.dumps(other))
    command = ("bench", "speed", "--recording", tmp_path / "own.h5", "--seconds", "1.5", "--repeats", "1")
    command = (*command, "--baseline", baseline)
    status, out, err = asyneio(*command, "--beside", "1", "--paced", "-o", tmp_path / "first.json", "--json")
    assert status == 0, err
    found = json.loads(out)
    assert json.loads((tmp_path / "first.json").read_text()) == found
    assert found["workload"]["seconds"] == pytest.approx(1.5, abs=0.02)
    assert found["workload"]["name"] == "own.h5"
    # Packets of 0.1 s; the first three without an estimate.
    estimates = found["pipeline"]["estimates"]
    assert (
        estimates == found["latency_ms"]["queued"]["estimates"] == found["latency_ms"]["paced"]["estimates"]
    )
    assert 9 <= estimates <= 12
    assert found["beside"]["processes"] == 1
    assert found["relative"]["front end"] > 0.0
    assert "note: not compared with the baseline: name is own.h5, that of the baseline other" in err
    status, _, err = asyneio(*command, "--gate", "1.5")
    assert status == 1
    assert "the gate needs a baseline of the same workload" in err


@pytest.mark.slow
def test_the_gate_of_speed(asyneio: Asyneio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "_process", _here)
    write_events_hdf5(make_event_recording(np.random.default_rng(7)), tmp_path / "own.h5")
    command = ("bench", "speed", "--recording", tmp_path / "own.h5", "--seconds", "1.2", "--repeats", "1")
    monkeypatch.setattr(speed_report, "_BASELINE", tmp_path / "absent.json")
    status, _, err = asyneio(*command, "-o", tmp_path / "first.json")
    assert status == 0
    assert "note: not compared with the baseline: this copy of the package contains none" in err
    status, _, err = asyneio(*command, "--gate", "1.5")
    assert status == 1
    assert "the gate needs a baseline: this copy of the package contains none" in err
    first = json.loads((tmp_path / "first.json").read_text())
    for kind in ("relative", "relative_cpu"):
        first[kind] = {name: 1.0 for name in first[kind]} | {"estimator": 1e-6, "front end": 1e6}
    (tmp_path / "first.json").write_text(json.dumps(first))
    command = (*command, "--baseline", tmp_path / "first.json")
    status, out, err = asyneio(*command, "--gate", "1e9")
    assert status == 0, err
    assert "| front end alone" in out
    first["relative"]["front end"] = first["relative_cpu"]["front end"] = 1e-6
    (tmp_path / "first.json").write_text(json.dumps(first))
    status, _, err = asyneio(*command, "--gate", "1.5")
    assert status == 1
    assert "slower than 1.5 times the baseline: front end" in err
