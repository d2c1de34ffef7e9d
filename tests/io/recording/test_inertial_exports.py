"""Inertial samples as other tools export them: columns and units by name, gravity as witness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording, read_inertial_file, write_uzh_folder
from asyneio.io.recording.inertial_units import check_units, turns_in_degrees
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, EventRecording, RecordArray
from tests.io.event_recordings import make_event_recording

COUNT = 400
T_NS = 1_600_000_000 * NS_PER_S + 5_000_000 * np.arange(COUNT)


def turning(rate: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Rates [rad/s] (N,3) of a body that rolls to and fro, and the gravity [m/s^2] (N,3) it feels."""
    s = (T_NS - T_NS[0]) / NS_PER_S
    roll = rate * np.sin(2.0 * s) / 2.0
    omega = np.stack([rate * np.cos(2.0 * s), 0 * s, 0 * s], axis=1)
    return omega, 9.80665 * np.stack([0 * s, np.sin(roll), np.cos(roll)], axis=1)


OMEGA, FORCE = turning()


def rows(*columns: np.ndarray | list[str], mark: str = ",") -> str:
    def text(value: object) -> str:
        return value if isinstance(value, str) else repr(value)

    fields = [column if isinstance(column, list) else column.tolist() for column in columns]
    return "".join(mark.join(map(text, row)) + "\n" for row in zip(*fields, strict=True))


def xyz(values: np.ndarray) -> list[np.ndarray]:
    return list(values.T)


def named(prefix: str) -> str:
    return ",".join(f"{prefix}{axis}" for axis in "xyz")


FRAMES = ["imu link"] * COUNT
ROSTOPIC = (
    f"%time,field.header.seq,field.header.stamp,field.header.frame_id,{named('field.angular_velocity.')},"
    f"field.angular_velocity_covariance0,{named('field.linear_acceleration.')}\n"
    + rows(
        T_NS + 3_000_000, np.arange(COUNT), T_NS, ["imu_link"] * COUNT, *xyz(OMEGA), OMEGA[:, 1], *xyz(FORCE)
    )
)
BAGPY = (
    f"Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,{named('angular_velocity.')},"
    f"{named('linear_acceleration.')}\n"
    + rows(T_NS / 1e9, np.arange(COUNT), T_NS // NS_PER_S, T_NS % NS_PER_S, FRAMES, *xyz(OMEGA), *xyz(FORCE))
)
DV = "timestamp,accelX,accelY,accelZ,gyroX,gyroY,gyroZ,temperature\n" + rows(
    T_NS // 1000, *xyz(FORCE / 9.80665), *xyz(np.degrees(OMEGA)), 36.5 + 0 * OMEGA[:, 0]
)
UNITS = "timestamp [ns],gyro_x [deg/s],gyro_y [deg/s],gyro_z [deg/s],acc_x [g],acc_y [g],acc_z [g]\n" + rows(
    T_NS, *xyz(np.degrees(OMEGA)), *xyz(FORCE / 9.80665)
)
SUFFIXES = "timestamp_us gyro_x_dps gyro_y_dps gyro_z_dps acc_x_m_s2 acc_y_m_s2 acc_z_m_s2\n" + rows(
    T_NS // 1000, *xyz(np.degrees(OMEGA)), *xyz(FORCE), mark=" "
)
ROS2 = rows(
    T_NS // NS_PER_S, T_NS % NS_PER_S, FRAMES, *np.zeros((13, COUNT)), *xyz(OMEGA), *np.zeros((9, COUNT)),
    *xyz(FORCE), *np.zeros((9, COUNT)),
)  # fmt: skip
AXES_FIRST = "t_ns,z_gyro,y_gyro,x_gyro,z_acc,y_acc,x_acc\n" + rows(
    T_NS, *xyz(OMEGA)[::-1], *xyz(FORCE)[::-1]
)
MILLI = "t_ns,gx [mdeg/s],gy [mdeg/s],gz [mdeg/s],ax [mg],ay [mg],az [mg]\n" + rows(
    T_NS, *xyz(1e3 * np.degrees(OMEGA)), *xyz(1e3 * FORCE / 9.80665)
)
COMMAS = "t;gx;gy;gz;ax;ay;az\n" + rows(T_NS / 1e9, *xyz(OMEGA), *xyz(FORCE), mark=";").replace(".", ",")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ROSTOPIC, "(from the header), time in ns"),
        (ROS2, "(from the header), time in s"),
        (AXES_FIRST, "(from the header), time in ns"),
        (MILLI, "gyroscope in mdeg/s (from the header)"),
        (BAGPY, "(from the header), time in s"),
        (DV, "accelerometer first (from the header), time in us"),
        (UNITS, "gyroscope in deg/s (from the header): converted to rad/s"),
        (SUFFIXES, "gyroscope in deg/s (from the header)"),
        (COMMAS, "commas read as decimal points"),
    ],
)
def test_exports(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(text)
    found = read_inertial_file(path)
    in_g, in_degrees = text is DV, text is DV
    np.testing.assert_allclose(found.gyroscope["t_ns"], T_NS, rtol=0, atol=0 if text is not COMMAS else 500)
    np.testing.assert_allclose(found.gyroscope["xyz"], np.degrees(OMEGA) if in_degrees else OMEGA, atol=1e-12)
    np.testing.assert_allclose(found.accelerometer["xyz"], FORCE / (9.80665 if in_g else 1.0), atol=1e-12)
    assert any(said in note for note in found.notes)


def streams(omega: np.ndarray, force: np.ndarray) -> tuple[RecordArray, RecordArray]:
    found = []
    for values in (omega, force):
        stream = np.empty(COUNT, dtype=INERTIAL_DTYPE)
        stream["t_ns"], stream["xyz"] = T_NS, values
        found.append(stream)
    return found[0], found[1]


@pytest.mark.parametrize("rate", [0.05, 0.3, 3.0])
def test_gravity_tells_degrees(rate: float) -> None:
    omega, force = turning(rate)
    assert turns_in_degrees(*streams(np.degrees(omega), force)) is True
    assert not turns_in_degrees(*streams(omega, force))


def test_gravity_tells_nothing_at_rest() -> None:
    assert turns_in_degrees(*streams(0.001 * OMEGA, np.tile([0.0, 0.0, 9.8], (COUNT, 1)))) is None


def test_gravity_of_real_recordings(data_dir: Path) -> None:
    for name in ("ecd_shapes_rotation_imu/imu.txt", "euroc_V1_01/imu0_data.csv", "tumvi_calib/imu.csv"):
        found = read_inertial_file(data_dir / name)
        assert not turns_in_degrees(found.gyroscope, found.accelerometer)
        found.gyroscope["xyz"] = np.degrees(found.gyroscope["xyz"])
        assert turns_in_degrees(found.gyroscope, found.accelerometer) is True


@pytest.fixture
def recording(rng: np.random.Generator) -> EventRecording:
    return make_event_recording(rng, 400)


def write_beside(folder: Path, recording: EventRecording, header: str, order: str = "wa") -> str:
    """Samples of a recording as text, with a header; `order` of the sensors."""
    t_ns = recording.gyroscope["t_ns"]
    sensors = {"w": recording.gyroscope["xyz"], "a": recording.accelerometer["xyz"]}
    write_uzh_folder(recording, folder)
    (folder / "imu.txt").unlink()
    return header + rows(t_ns, *(axis for sensor in order for axis in xyz(sensors[sensor])))


def test_files_beside_events(tmp_path: Path, recording: EventRecording) -> None:
    text = write_beside(tmp_path, recording, "t_ns,gx,gy,gz,ax,ay,az\n")
    for name, content in (("imu.csv", text), ("imu.txt", text.replace(",", " "))):
        (tmp_path / name).write_text(content)
        np.testing.assert_array_equal(open_recording(tmp_path).gyroscope, recording.gyroscope)
        (tmp_path / name).unlink()


def test_a_file_for_each_sensor(tmp_path: Path, recording: EventRecording) -> None:
    write_beside(tmp_path, recording, "")
    for name, stream, header in (
        ("gyroscope.csv", recording.gyroscope, "timestamp [ns],x,y,z\n"),
        ("accelerometer.csv", recording.accelerometer[::2], "t_ns,acc_x,acc_y,acc_z\n"),
    ):
        (tmp_path / name).write_text(header + rows(stream["t_ns"], *xyz(stream["xyz"])))
    found = open_recording(tmp_path)
    np.testing.assert_array_equal(found.gyroscope, recording.gyroscope)
    np.testing.assert_array_equal(found.accelerometer, recording.accelerometer[::2])


def test_dates_are_refused_and_the_cure_works(tmp_path: Path, recording: EventRecording) -> None:
    header = "time,gx,gy,gz,ax,ay,az\n"
    text = write_beside(tmp_path, recording, header)
    body = text[len(header) :].splitlines()
    dates = [
        f"2020-09-13T12:26:{k // 100:02d}.{k % 100:02d},{line.split(',', 1)[1]}"
        for k, line in enumerate(body)
    ]
    (tmp_path / "imu.csv").write_text(header + "\n".join(dates) + "\n")
    with pytest.raises(RecordingError, match=r"'2020-09-13T12:26:00.*Times must be numbers.*nanoseconds"):
        open_recording(tmp_path)
    (tmp_path / "imu.csv").write_text(text)
    np.testing.assert_array_equal(open_recording(tmp_path).gyroscope, recording.gyroscope)


def test_what_rostopic_prints_is_named(tmp_path: Path) -> None:
    path = tmp_path / "imu.txt"
    path.write_text("header: \n  seq: 1\n  stamp: \n    secs: 1600000000\n---\n" * 40)
    with pytest.raises(RecordingError, match="rostopic echo -p TOPIC"):
        read_inertial_file(path)


def test_an_unknown_unit_is_named(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text(UNITS.replace("[deg/s]", "[rpm]"))
    with pytest.raises(
        RecordingError, match="names the unit 'rpm' for the gyroscope; supported: rad/s, deg/s"
    ):
        read_inertial_file(path)


def test_times_with_too_few_digits(tmp_path: Path) -> None:
    path = tmp_path / "imu.txt"
    path.write_text(rows([f"{t / 1e9:.6g}" for t in T_NS.tolist()], *xyz(OMEGA), *xyz(FORCE), mark=" "))
    with pytest.raises(RecordingError, match="printed with too few digits"):
        read_inertial_file(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t [ns],gx,gy,gz,ax,ay,az\n" + rows(T_NS / 1e9, *xyz(OMEGA), *xyz(FORCE)), "write s in the header"),
        (
            "t_ns,gx,gy,gz,ax,ay,az\n" + rows([f"{t:.5e}" for t in T_NS], *xyz(OMEGA), *xyz(FORCE)),
            "printed with too few digits",
        ),
        (
            "t_ns,gx [rpm],gy [rpm],gz [rpm],ax,ay,az\n" + rows(T_NS, *xyz(OMEGA), *xyz(FORCE)),
            "deg/s, mdeg/s",
        ),
    ],
)
def test_wrong_units_in_the_header_are_named(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "imu.csv").write_text(text)
    with pytest.raises(RecordingError, match=said):
        read_inertial_file(tmp_path / "imu.csv")


@pytest.mark.parametrize("name", ["IMU.CSV", "Imu.csv"])
def test_names_in_upper_case_are_found(tmp_path: Path, rng: np.random.Generator, name: str) -> None:
    write_uzh_folder(make_event_recording(rng), tmp_path)
    (tmp_path / "imu.txt").rename(tmp_path / name)
    found = open_recording(tmp_path)
    assert isinstance(found, EventRecording)
    assert found.gyroscope.size


def test_counts_and_thousandths_are_named(tmp_path: Path) -> None:
    for factor, said in ((1e3, "This fits mg"), (2048.0, "raw counts of 2048 per g")):
        columns = [T_NS, *xyz(OMEGA), *xyz(factor * FORCE / 9.80665)]
        (tmp_path / "imu.csv").write_text("t_ns,gx,gy,gz,ax,ay,az\n" + rows(*columns))
        streams = read_inertial_file(tmp_path / "imu.csv")
        with pytest.raises(RecordingError, match=said):
            check_units(streams.gyroscope, streams.accelerometer, ())
