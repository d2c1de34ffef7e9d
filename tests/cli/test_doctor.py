"""`asyneio doctor` on the command line: text, JSON, exit status; no input makes it crash."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from asyneio.doctor import Severity, examine
from asyneio.io import write_events_hdf5, write_uzh_folder
from tests.cli.conftest import Asyneio
from tests.io.event_recordings import make_event_recording


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    write_uzh_folder(make_event_recording(rng, 30_000), tmp_path / "desk")
    return tmp_path / "desk"


@pytest.mark.slow
def test_text(asyneio: Asyneio, folder: Path) -> None:
    status, out, err = asyneio("doctor", folder)
    assert status == 0, out + err
    assert "OK" in out
    assert "imu units" in out
    assert "usable for asyneio run and asyneio track" in out
    assert "Mev/s" in out.splitlines()[-1]
    assert err == ""


def test_json_has_the_documented_keys(asyneio: Asyneio, folder: Path) -> None:
    status, out, _ = asyneio("doctor", folder, "--json")
    assert status == 0
    found = json.loads(out)
    keys = "recording worst usable_for headline summary results repairs events seconds reading_s"
    assert set(found) == set(keys.split())
    assert found["usable_for"] == ["run", "track"]
    assert found["events"] == 30_000
    for result in found["results"]:
        assert set(result) == {"check", "severity", "measured", "expected", "fix", "values", "prevents"}
        assert result["severity"] in Severity.__members__
        # Every problem comes with a fix.
        assert result["severity"] in ("OK", "NOTE") or result["fix"] or result["check"] == "recording"
    checks = [result["check"] for result in found["results"]]
    assert len(set(checks)) == len(checks)


def test_fail_sets_the_exit_status_and_warning_does_not(asyneio: Asyneio, folder: Path) -> None:
    (folder / "imu.txt").unlink()
    status, out, _ = asyneio("doctor", folder)
    assert status == 0
    assert "WARNING" in out
    assert "usable for asyneio track" in out
    (folder / "events.txt").write_text("0.1 1 1 1\n")
    status, out, err = asyneio("doctor", folder)
    assert status == 1
    assert "FAIL    event rate: 1 event(s)" in out
    assert err == ""


def test_missing_recording(asyneio: Asyneio, tmp_path: Path) -> None:
    for path, words in ((tmp_path / "none", "does not exist"), (tmp_path, "no file")):
        status, out, err = asyneio("doctor", path)
        assert status == 1
        assert words in " ".join(out.split())
        assert err == ""


def test_a_calibration_in_another_folder(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    for name in ("camchain-imucam.yaml", "imu.yaml"):
        (folder / name).rename(tmp_path / name)
    given_files = ("--calibration", tmp_path / "camchain-imucam.yaml", "--imu", tmp_path / "imu.yaml")
    status, out, _ = asyneio("doctor", folder, *given_files, "--json")
    results = {result["check"]: result["severity"] for result in json.loads(out)["results"]}
    assert status == 0
    assert results["calibration"] == "OK"


@pytest.mark.slow
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(
        [
            b"",
            b"#!AER-DAT2.0\r\n",
            b"\x89HDF\r\n\x1a\n",
            b"% evt 2.0\n",
            b"0.1 1 1 1\n",
            b"PK\x03\x04",
        ]
    ),
    st.binary(max_size=400),
    st.sampled_from(
        ["a.bin", "events.txt", "imu.csv", "imu.txt", "tracks.csv", "camchain-imucam.yaml", "calib.txt"]
    ),
)
def test_arbitrary_bytes_do_not_crash_it(tmp_path: Path, head: bytes, rest: bytes, name: str) -> None:
    folder = tmp_path / "fuzz"
    folder.mkdir(exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    (folder / name).write_bytes(head + rest)
    for path in (folder, folder / name):
        report = examine(path)
        assert report.results
        json.dumps(report.to_dict(), allow_nan=False)


@pytest.mark.slow
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_damage_anywhere_in_a_recording_does_not_crash_it(
    tmp_path: Path, rng: np.random.Generator, data: st.DataObject
) -> None:
    folder = tmp_path / "damaged"
    if not folder.exists():
        write_uzh_folder(make_event_recording(rng, 1500), folder)
        write_events_hdf5(make_event_recording(rng, 1500), tmp_path / "whole.h5")
    files = sorted(folder.iterdir())
    file = data.draw(st.sampled_from([*files, tmp_path / "whole.h5"]))
    whole = file.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    try:
        file.write_bytes(whole[:at] + data.draw(st.binary(max_size=30)) + whole[at + 20 :])
        report = examine(file if file.suffix == ".h5" else folder)
        json.dumps(report.to_dict(), allow_nan=False)
        assert report.results
    finally:
        file.write_bytes(whole)


@pytest.mark.slow
def test_impossible_readings_do_not_crash_it(tmp_path: Path, rng: np.random.Generator) -> None:
    recording = make_event_recording(rng, 5000)
    for row, (stamp, reading) in enumerate([(0, 1e300), (0, np.inf), (2**62, 1.0), (0, np.nan)]):
        gyroscope = recording.gyroscope.copy()
        gyroscope["t_ns"][row] += stamp
        gyroscope["xyz"][row] = reading
        path = tmp_path / f"{row}.h5"
        write_events_hdf5(dataclasses.replace(recording, gyroscope=gyroscope), path)
        found = examine(path)
        assert found.worst >= Severity.NOTE
        json.dumps(found.to_dict(), allow_nan=False)
