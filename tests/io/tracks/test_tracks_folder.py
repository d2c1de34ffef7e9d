"""Tracks folder: exact round trip, every fault of the table tripped, garbage never escapes."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import CalibrationError, RecordingError
from asyneio.io import ReadOptions, read_tracks_folder, write_tracks_folder
from asyneio.types import Recording
from tests.io.recordings import START_NS, make_recording


@pytest.fixture
def recording(rng: np.random.Generator) -> Recording:
    return make_recording(rng)


@pytest.fixture
def folder(tmp_path: Path, recording: Recording) -> Path:
    write_tracks_folder(recording, tmp_path / "run")
    return tmp_path / "run"


def edit_rows(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *change(rows)]) + "\n")


def scale_column(path: Path, names: str, factor: float) -> None:
    header, *rows = path.read_text().splitlines()
    wanted = {header.split(",").index(name) for name in names.split()}
    scaled = [
        ",".join(
            repr(float(token) * factor) if index in wanted else token
            for index, token in enumerate(row.split(","))
        )
        for row in rows
    ]
    path.write_text("\n".join([header, *scaled]) + "\n")


def scale_stamps(path: Path, divisor: int, origin: int = 0) -> None:
    edit_rows(
        path,
        lambda rows: [
            f"{(int(t) - origin) // divisor},{rest}" for t, rest in (row.split(",", 1) for row in rows)
        ],
    )


def assert_equal(found: Recording, expected: Recording) -> None:
    np.testing.assert_array_equal(found.observations, expected.observations)
    np.testing.assert_array_equal(found.gyroscope, expected.gyroscope)
    np.testing.assert_array_equal(found.accelerometer, expected.accelerometer)
    np.testing.assert_array_equal(found.calibration.T_b_c, expected.calibration.T_b_c)
    assert found.calibration.camera == expected.calibration.camera
    assert found.calibration.noise == expected.calibration.noise
    assert found.calibration.timeshift_ns == expected.calibration.timeshift_ns
    assert found.ground_truth is not None
    assert expected.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.t_ns, expected.ground_truth.t_ns)
    np.testing.assert_array_equal(found.ground_truth.position, expected.ground_truth.position)
    np.testing.assert_array_equal(found.ground_truth.quaternion, expected.ground_truth.quaternion)


@pytest.mark.parametrize("accelerometer_hz", [200.0, 190.0])
def test_round_trip_is_exact(tmp_path: Path, rng: np.random.Generator, accelerometer_hz: float) -> None:
    recording = make_recording(rng, accelerometer_hz=accelerometer_hz)
    write_tracks_folder(recording, tmp_path)
    assert (tmp_path / "imu.csv").exists() == (accelerometer_hz == 200.0)
    assert_equal(read_tracks_folder(tmp_path), recording)


def test_writing_again_removes_the_other_layout(tmp_path: Path, rng: np.random.Generator) -> None:
    write_tracks_folder(make_recording(rng, accelerometer_hz=200.0), tmp_path)
    separate = replace(make_recording(rng, accelerometer_hz=190.0), ground_truth=None)
    write_tracks_folder(separate, tmp_path)
    found = read_tracks_folder(tmp_path)
    np.testing.assert_array_equal(found.accelerometer, separate.accelerometer)
    assert found.ground_truth is None


def test_stamps_move_from_the_camera_clock_to_the_imu_clock(folder: Path, recording: Recording) -> None:
    written = int((folder / "tracks.csv").read_text().splitlines()[1].split(",")[0])
    assert written == recording.observations["t_ns"][0] + 1_234_567
    assert read_tracks_folder(folder).observations["t_ns"][0] == recording.observations["t_ns"][0]


def test_columns_are_found_by_name(folder: Path, recording: Recording) -> None:
    path = folder / "tracks.csv"
    rows = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("".join(f"# {v}, {u}, {i}, {t}\r\n" if t == "t_ns" else f"{v}, {u}, {i}, {t}\r\n"
                            for t, i, u, v in rows))  # fmt: skip
    np.testing.assert_array_equal(read_tracks_folder(folder).observations, recording.observations)


def test_garbage_lines_are_skipped_and_named(folder: Path, recording: Recording) -> None:
    bad = ["garbage", "1,2", f"{START_NS},1,nan,5.0", f"{START_NS},1,5.0,inf", "1.6e18,3,1.0,1.0"]
    edit_rows(folder / "tracks.csv", lambda rows: rows[:3] + bad + rows[3:])
    found = read_tracks_folder(folder)
    np.testing.assert_array_equal(found.observations, recording.observations)
    assert "tracks.csv: skipped 5 unreadable line(s), number 5, 6, 7, 8, 9" in found.notes


def test_too_much_garbage_stops(folder: Path) -> None:
    edit_rows(folder / "imu.csv", lambda rows: rows[:3] + ["?"] * 21 + rows[3:])
    with pytest.raises(RecordingError, match=r"more than 20 unreadable lines, the last at 25"):
        read_tracks_folder(folder)


@pytest.mark.parametrize("header", ["t,id,u,v", "t_ns,id,u", "", f"{START_NS},1,2.0,3.0"])
def test_wrong_columns_stop(folder: Path, header: str) -> None:
    rows = (folder / "tracks.csv").read_text().splitlines()[1:]
    (folder / "tracks.csv").write_text("\n".join([header, *rows]))
    with pytest.raises(RecordingError, match=r"expected a header line naming the columns t_ns,id,u,v"):
        read_tracks_folder(folder)


def test_small_disorder_is_sorted_and_counted(folder: Path, recording: Recording) -> None:
    def swap(rows: list[str]) -> list[str]:
        return [*rows[:20], rows[21], rows[20], *rows[22:]]

    edit_rows(folder / "imu.csv", swap)
    found = read_tracks_folder(folder)
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    assert "imu.csv: sorted 1 backward step(s) in time, at most 5.00 ms" in found.notes


def test_large_disorder_stops(folder: Path) -> None:
    edit_rows(folder / "imu.csv", lambda rows: rows[100:] + rows[:100])
    with pytest.raises(RecordingError, match=r"time runs backwards by 1995\.0 ms"):
        read_tracks_folder(folder)


def test_repeated_inertial_stamps_are_dropped(folder: Path, recording: Recording) -> None:
    edit_rows(folder / "imu.csv", lambda rows: [*rows[:10], rows[9], rows[9], *rows[10:]])
    found = read_tracks_folder(folder)
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    assert "imu.csv: dropped 2 sample(s) with a repeated time stamp" in found.notes


def test_an_id_twice_at_one_time_is_dropped(folder: Path, recording: Recording) -> None:
    edit_rows(folder / "tracks.csv", lambda rows: [*rows[:12], rows[4], *rows[12:]])
    found = read_tracks_folder(folder)
    np.testing.assert_array_equal(found.observations, recording.observations)
    assert "tracks: dropped 1 duplicate observation(s)" in found.notes


def test_many_repeated_ids_stop(folder: Path) -> None:
    edit_rows(folder / "tracks.csv", lambda rows: [row for row in rows for _ in range(2)])
    with pytest.raises(RecordingError, match=r"480 of 960 observations repeat an id"):
        read_tracks_folder(folder)


def test_few_pixels_outside_are_dropped(folder: Path, recording: Recording) -> None:
    edit_rows(folder / "tracks.csv", lambda rows: [*rows, f"{rows[-1].split(',')[0]},99,-1.5,20.0"])
    found = read_tracks_folder(folder)
    np.testing.assert_array_equal(found.observations, recording.observations)
    assert "tracks: dropped 1 observation(s) outside the sensor" in found.notes


def test_many_pixels_outside_stop(folder: Path) -> None:
    scale_column(folder / "tracks.csv", "u", 1.5)
    with pytest.raises(RecordingError, match=r"outside the 240 x 180 sensor .* wrong resolution"):
        read_tracks_folder(folder)


@pytest.mark.parametrize(
    ("divisor", "unit"), [(10**3, "microseconds"), (10**6, "milliseconds"), (10**9, "seconds")]
)
def test_disjoint_times_print_ranges_and_likely_factor(folder: Path, divisor: int, unit: str) -> None:
    scale_stamps(folder / "tracks.csv", divisor)
    # A real recording has distinct ids at same stamp however coarse; here only the frame's first rows stay.
    edit_rows(folder / "tracks.csv", lambda rows: list({r.split(",")[0]: r for r in rows}.values()))
    with pytest.raises(RecordingError) as caught:
        read_tracks_folder(folder)
    message = str(caught.value)
    assert "do not overlap" in message
    assert f"are the stamps of tracks.csv in {unit}?" in message
    assert str(START_NS) in message


def test_unit_found_by_length_when_both_start_at_zero(folder: Path) -> None:
    scale_stamps(folder / "imu.csv", 1, START_NS)
    scale_stamps(folder / "tracks.csv", 1000, START_NS)
    with pytest.raises(
        RecordingError, match=r"differ by a power of a thousand .*stamps of tracks.csv in microseconds"
    ):
        read_tracks_folder(folder)


def test_disjoint_clocks_print_the_offset(folder: Path) -> None:
    scale_stamps(folder / "imu.csv", 1, 100 * 10**9)
    with pytest.raises(RecordingError, match=r"clocks are about -100\.00\d s apart"):
        read_tracks_folder(folder)


def test_inertial_stamps_in_microseconds_stop(folder: Path) -> None:
    scale_stamps(folder / "imu.csv", 1000)
    with pytest.raises(RecordingError, match=r"2e\+05 Hz.*are the stamps in microseconds"):
        read_tracks_folder(folder)


def test_declared_rate_is_compared(folder: Path) -> None:
    with (folder / "imu.yaml").open("a") as stream:
        stream.write("update_rate: 400.0\n")
    assert "imu.csv: measured rate 200.0 Hz, but the calibration says 400.0 Hz" in (
        read_tracks_folder(folder).notes
    )


def test_gaps_are_noted(folder: Path) -> None:
    assert not any("gap" in note for note in read_tracks_folder(folder).notes)
    edit_rows(folder / "imu.csv", lambda rows: rows[:50] + rows[53:100] + rows[109:])
    assert "imu.csv: 2 gap(s) without samples, at most 50.0 ms" in read_tracks_folder(folder).notes


def test_accelerometer_in_g_is_converted(folder: Path, recording: Recording) -> None:
    scale_column(folder / "imu.csv", "ax ay az", 1.0 / 9.80665)
    found = read_tracks_folder(folder)
    np.testing.assert_allclose(found.accelerometer["xyz"], recording.accelerometer["xyz"], rtol=1e-12)
    np.testing.assert_array_equal(found.gyroscope["xyz"], recording.gyroscope["xyz"])
    assert any("it is in g" in note for note in found.notes)
    assert any("assumed to be in rad/s" in note for note in found.notes)


def test_degrees_are_converted(folder: Path, recording: Recording) -> None:
    scale_column(folder / "imu.csv", "ax ay az", 1.0 / 9.80665)
    scale_column(folder / "imu.csv", "gx gy gz", 10.0 * 180.0 / np.pi)
    found = read_tracks_folder(folder)
    np.testing.assert_allclose(found.gyroscope["xyz"], 10.0 * recording.gyroscope["xyz"], rtol=1e-12)
    assert any("it is in deg/s" in note for note in found.notes)


def test_exchanged_columns_are_swapped_back(folder: Path, recording: Recording) -> None:
    path = folder / "imu.csv"
    path.write_text(path.read_text().replace("gx,gy,gz,ax,ay,az", "ax,ay,az,gx,gy,gz"))
    found = read_tracks_folder(folder)
    np.testing.assert_array_equal(found.accelerometer, recording.accelerometer)
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    assert any("were swapped" in note for note in found.notes)


def test_slow_turn_in_degrees_is_not_taken_for_gravity(tmp_path: Path, rng: np.random.Generator) -> None:
    recording = make_recording(rng)
    recording.gyroscope["xyz"] *= 9.81 / np.median(np.linalg.norm(recording.gyroscope["xyz"], axis=1))
    recording.accelerometer["xyz"] /= 9.81
    write_tracks_folder(recording, tmp_path)
    found = read_tracks_folder(tmp_path)
    # Gravity does not turn as much as this would be in rad/s.
    np.testing.assert_allclose(found.gyroscope["xyz"], np.radians(recording.gyroscope["xyz"]), rtol=1e-12)
    assert any("the rotation of gravity fits a gyroscope in deg/s" in note for note in found.notes)


@pytest.mark.parametrize(
    ("factor", "outcome"), [(0.05, "stop"), (1000.0, "stop"), (1.2, "note"), (0.85, "note")]
)
def test_implausible_gravity(folder: Path, factor: float, outcome: str) -> None:
    scale_column(folder / "imu.csv", "ax ay az", factor)
    if outcome == "stop":
        with pytest.raises(RecordingError, match=r"expected about 9\.81 m/s\^2"):
            read_tracks_folder(folder)
    else:
        assert any("expected about 9.81" in note for note in read_tracks_folder(folder).notes)


@pytest.mark.parametrize("name", ["tracks.csv", "imu.csv", "camchain-imucam.yaml", "imu.yaml"])
def test_missing_and_empty_files_are_named(folder: Path, name: str) -> None:
    (folder / name).write_text("")
    with pytest.raises((RecordingError, CalibrationError), match=name):
        read_tracks_folder(folder)
    (folder / name).unlink()
    with pytest.raises((RecordingError, CalibrationError), match=name):
        read_tracks_folder(folder)


def test_a_header_alone_is_no_recording(folder: Path) -> None:
    (folder / "tracks.csv").write_text("t_ns,id,u,v\n# nothing\n\n")
    with pytest.raises(RecordingError, match="contains no readable row"):
        read_tracks_folder(folder)


def test_path_that_is_no_folder(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="is not a folder"):
        read_tracks_folder(tmp_path / "absent")


def test_calibration_may_lie_elsewhere(folder: Path, recording: Recording) -> None:
    camchain = (folder / "camchain-imucam.yaml").rename(folder.parent / "camera.yaml")
    imu = (folder / "imu.yaml").rename(folder.parent / "noise.yaml")
    assert_equal(read_tracks_folder(folder, ReadOptions(camchain, imu)), recording)


def test_real_recording(data_dir: Path) -> None:
    found = read_tracks_folder(data_dir / "tumvi_calib")
    assert found.observations.size == 67_391
    assert found.gyroscope.size == found.accelerometer.size == 5_184
    assert found.ground_truth is not None
    assert found.ground_truth.t_ns[0] == 1_520_527_960_237_865_414
    assert found.calibration.timeshift_ns == 375_000
    assert found.observations["t_ns"][0] == 1_520_527_958_513_480_192 + 375_000
    assert np.linalg.det(found.calibration.T_b_c[:3, :3]) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    "name", ["imu.csv", "camchain-imucam.yaml", "imu.yaml", "groundtruth.tum", "tracks.csv"]
)
def test_a_folder_that_cannot_be_completed_has_no_tracks(
    rng: np.random.Generator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    recording = make_recording(rng)
    write_tracks_folder(recording, tmp_path)  # of an earlier run
    mkstemp = tempfile.mkstemp

    def full(dir: Path, prefix: str, suffix: str) -> tuple[int, str]:
        if prefix == f".{name}.":
            raise OSError(errno.ENOSPC, "No space left on device")
        return mkstemp(dir=dir, prefix=prefix, suffix=suffix)

    monkeypatch.setattr("tempfile.mkstemp", full)
    with pytest.raises(RecordingError, match=f"cannot write .*{name}: No space left on device"):
        write_tracks_folder(recording, tmp_path)
    assert not (tmp_path / "tracks.csv").exists()
