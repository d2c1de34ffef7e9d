"""Files that people take for calibrations, and those of more tools: read, or named with what to give."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import CalibrationError
from asyneio.io import read_calibration
from asyneio.io.calibration import find_calibration
from asyneio.types import Calibration
from tests.io.calibration.rigs import KINDS, kalibr, make_rig

RIG = make_rig()
T_C_B = np.linalg.inv(RIG.T_b_c)
FLAT = "cam0:\ncamera_model: pinhole\nintrinsics: [200, 200, 120, 90]\nresolution: [240, 180]\n"
IMU_UTILS = (
    "%YAML:1.0\n---\ntype: IMU\nGyr:\n   avg-axis:\n      gyr_n: 1.5e-02\n"
    "Acc:\n   avg-axis:\n      acc_n: 0.15\n"
)


def assert_same(found: Calibration, shift_ns: int) -> None:
    assert (found.camera.width, found.camera.height) == (RIG.camera.width, RIG.camera.height)
    np.testing.assert_allclose(found.camera.coefficients, RIG.camera.coefficients, rtol=1e-12)
    np.testing.assert_allclose(found.T_b_c, RIG.T_b_c, atol=1e-6)
    assert found.timeshift_ns == shift_ns
    for name in ("gyroscope_density", "accelerometer_density", "gyroscope_walk", "accelerometer_walk"):
        assert getattr(found.noise, name) == pytest.approx(getattr(RIG.noise, name), rel=1e-12)


@pytest.mark.parametrize("old", [False, True])
def test_orbslam(tmp_path: Path, old: bool) -> None:
    lens, noise, prefix = RIG.camera, RIG.noise, "Camera" if old else "Camera1"
    values = dict(zip(("fx", "fy", "cx", "cy"), (lens.fx, lens.fy, lens.cx, lens.cy), strict=True))
    values |= dict(zip(("k1", "k2", "p1", "p2"), lens.coefficients, strict=False))
    lines = [
        "%YAML:1.0",
        'Camera.type: "PinHole"',
        *(f"{prefix}.{key}: {value!r}" for key, value in values.items()),
    ]
    lines += [f"Camera.width: {lens.width}", f"Camera.height: {lens.height}"]
    flat = ", ".join(map(repr, RIG.T_b_c.ravel().tolist()))
    lines.append(
        f"{'Tbc' if old else 'IMU.T_b_c1'}: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: f\n   data: "
        f"[{flat}]"
    )
    lines += [f"IMU.NoiseGyro: {noise.gyroscope_density!r}", f"IMU.NoiseAcc: {noise.accelerometer_density!r}"]
    lines += [f"IMU.GyroWalk: {noise.gyroscope_walk!r}", f"IMU.AccWalk: {noise.accelerometer_walk!r}"]
    path = tmp_path / "settings.yaml"
    path.write_text("\n".join(lines) + "\n")
    found, notes = read_calibration(path)
    assert_same(found, 0)
    assert any("(camera to body)" in note for note in notes)


@pytest.mark.parametrize("listed", [False, True])
def test_inivation(tmp_path: Path, listed: bool) -> None:
    """As dv-processing writes it, with numbers in quotes, and as lists."""
    lens, noise = RIG.camera, RIG.noise

    def quoted(values: object) -> list[str]:
        return [str(value) for value in np.ravel(values).tolist()]

    camera = {
        "name": "DVXplorer", "resolution": quoted([lens.width, lens.height]),
        "focalLength": quoted([lens.fx, lens.fy]), "principalPoint": quoted([lens.cx, lens.cy]),
        "distortionCoefficients": quoted([*lens.coefficients, 0.0]), "distortionModel": "radialTangential",
    }  # fmt: skip
    imu = {
        "transformationToC0": quoted(T_C_B), "timeOffsetMicros": "2400", "omegaOffsetAvg": ["0.01", "0", "0"],
        "omegaNoiseDensity": repr(noise.gyroscope_density),
        "accNoiseDensity": repr(noise.accelerometer_density),
        "omegaNoiseRandomWalk": repr(noise.gyroscope_walk),
        "accNoiseRandomWalk": repr(noise.accelerometer_walk),
    }  # fmt: skip
    content = (
        {"cameras": [camera], "imu": [imu]} if listed else {"cameras": {"C0": camera}, "imus": {"S0": imu}}
    )
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(content))
    found, notes = read_calibration(path)
    assert_same(found, 2_400_000)
    assert any("omegaOffsetAvg are not applied" in note for note in notes)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        (
            "results-imucam.txt",
            "Calibration results\n====\nT_ci: [[1]]\n",
            "text report of Kalibr; .*use camchain-imu",
        ),
        ("report.pdf", "%PDF-1.4\n", "a PDF report; .*use camchain-imucam"),
        ("ost.txt", "# oST version 5.0 parameters\n", "use ost.yaml"),
        (
            "target.yaml",
            "target_type: 'aprilgrid'\ntagCols: 6\n",
            "calibration target .aprilgrid.; .*camchain-imucam",
        ),
        ("flat.yaml", FLAT, "expected them below cam0:, indented by two blanks"),
        (
            "imu_param.yaml",
            IMU_UTILS,
            "imu_utils: .*gyroscope_noise_density: 0.015 .* root of the IMU rate",
        ),
        (
            "camera.txt",
            "RadTan 200 200 120 90 -0.3 0.1 0 0\n240 180\n",
            "camera file of DSO; .*distortion_coeffs",
        ),
        (
            "okvis.yaml",
            "cameras:\n  - {T_SC: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}\n",
            "configuration of OKVIS; .*T_imu_cam",
        ),
        ("params.mat", "MATLAB 5.0 MAT-file\0\0", "a MATLAB file"),
        ("picture.png", "\x89PNG\r\n\x1a\n\0\0IHDR", "is not text"),
        ("empty.yaml", "", "empty.yaml is empty"),
        ("blank.yaml", "---\n\n", "blank.yaml is empty"),
        ("comment.yaml", "# nothing\n", "contains only comments"),
    ],
)
def test_what_is_no_calibration(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(CalibrationError, match=said):
        read_calibration(tmp_path / name)


def test_the_fixes_work(tmp_path: Path) -> None:
    chain, imu = kalibr(tmp_path, RIG)
    (tmp_path / "results-imucam.txt").write_text("Calibration results\n")
    with pytest.raises(CalibrationError, match=f"use {chain.name}"):
        read_calibration(tmp_path / "results-imucam.txt")
    assert_same(read_calibration(chain, imu)[0], RIG.timeshift_ns)
    first, *rest = FLAT.splitlines()
    (tmp_path / "flat.yaml").write_text("\n".join([first, *(f"  {line}" for line in rest)]))
    assert find_calibration(tmp_path, tmp_path / "flat.yaml", None).resolve(None)[0].camera is not None


def test_a_known_sidecar_file_is_reported(tmp_path: Path) -> None:
    (tmp_path / "davis_imu_param.yaml").write_text(IMU_UTILS)
    (tmp_path / "other.yaml").write_text("nothing: known\n")
    notes = find_calibration(tmp_path, None, None).notes
    assert [note[:9] for note in notes] == ["not used:"]
    assert "imu_utils" in notes[0]


@pytest.mark.parametrize(
    ("written", "meant", "unit"),
    [("2.4", "0.0024", "ms"), ("-5600", "-0.0056", "us"), ("2400000", "0.0024", "ns")],
)
def test_a_time_shift_in_another_unit(tmp_path: Path, written: str, meant: str, unit: str) -> None:
    chain, imu = kalibr(tmp_path, RIG)
    text = chain.read_text().replace("timeshift_cam_imu: 0.0024", f"timeshift_cam_imu: {written}")
    chain.write_text(text)
    with pytest.raises(CalibrationError, match=rf"less than 1. If .* {unit} are meant, write {meant};"):
        read_calibration(chain, imu)
    chain.write_text(text.replace(f"imu: {written}", f"imu: {meant}"))
    assert read_calibration(chain, imu)[0].timeshift_ns == round(1e9 * float(meant))
    chain.write_text(text.replace(f"imu: {written}", "imu: 0.4"))
    assert any(
        "between camera and IMU, 0.4 s, is unusually large" in note
        for note in read_calibration(chain, imu)[1]
    )


@pytest.mark.parametrize(
    ("kind", "line", "said"),
    [
        ("kalibr", "time_offset: 0.01\n", "time_offset is not applied"),
        ("vins-mono", "g_norm: 9.7\n", "g_norm is not applied: gravity is 9.80665"),
        ("vins-mono", "rolling_shutter: 1\n", "rolling_shutter is not applied"),
    ],
)
def test_keys_that_are_not_applied(tmp_path: Path, kind: str, line: str, said: str) -> None:
    camera, imu = KINDS[kind](tmp_path, RIG)
    target = imu or camera
    assert not any("is not applied" in note for note in read_calibration(camera, imu)[1])
    target.write_text(target.read_text() + line)
    assert any(said in note for note in read_calibration(camera, imu)[1])
