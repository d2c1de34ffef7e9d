"""Kalibr files: both extrinsic keys, every impossible value refused, hostile YAML harmless."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import CalibrationError
from asyneio.io import read_calibration, write_camchain, write_imu_noise
from asyneio.types import Calibration, Distortion
from tests.io.recordings import make_calibration
from tests.io.validity import assert_valid_calibration, valid_or_rejected


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    camchain, imu = tmp_path / "camchain-imucam.yaml", tmp_path / "imu.yaml"
    write_camchain(camchain, make_calibration())
    write_imu_noise(imu, make_calibration().noise)
    return camchain, imu


def change(path: Path, key: str, value: Any, remove: bool = False) -> None:
    content = yaml.safe_load(path.read_text())
    section = content.get("cam0", content)
    section[key] = value
    if remove:
        del section[key]
    path.write_text(yaml.safe_dump(content))


def flip(calibration: Calibration) -> list[list[float]]:
    """`T_cam_imu` of a calibration, by an independent inverse."""
    inverse: list[list[float]] = np.linalg.inv(calibration.T_b_c).tolist()
    inverse[3] = [0.0, 0.0, 0.0, 1.0]
    return inverse


@pytest.mark.parametrize(
    ("distortion", "coefficients"),
    [
        (Distortion.NONE, ()),
        (Distortion.RADTAN, (0.1, 0.2, 1e-5, -1e-300)),
        (Distortion.RADTAN, (0.1, 0.02, 3e-4, -0.4e-4, 0.5)),
        (Distortion.RADTAN, (0.0, 0.0, 0.0, 0.0)),
        (Distortion.RADTAN, (0.9, 0.3, 1e-3, -5e-4, 0.02, 1.3, 0.6, 0.1)),
        (Distortion.RADTAN, (0.9, 0.3, 1e-3, -5e-4, 0.02, 1.3, 0.6, 0.1, 1e-3, 1e-4, -1e-3, 2e-4)),
        (Distortion.EQUIDISTANT, (0.1, -0.2, 0.3, 1.0 / 3.0)),
    ],
)
def test_round_trip(tmp_path: Path, distortion: Distortion, coefficients: tuple[float, ...]) -> None:
    calibration = make_calibration()
    camera = replace(calibration.camera, distortion=distortion, coefficients=coefficients)
    noise = replace(calibration.noise, rate_hz=199.4)
    write_camchain(tmp_path / "c.yaml", replace(calibration, camera=camera))
    write_imu_noise(tmp_path / "i.yaml", noise)
    found, _ = read_calibration(tmp_path / "c.yaml", tmp_path / "i.yaml")
    np.testing.assert_array_equal(found.T_b_c, calibration.T_b_c)
    assert (found.camera, found.noise, found.timeshift_ns) == (camera, noise, calibration.timeshift_ns)


def test_kalibr_key_alone_maps_imu_to_camera(files: tuple[Path, Path]) -> None:
    change(files[0], "T_imu_cam", None, remove=True)
    change(files[0], "T_cam_imu", flip(make_calibration()))
    found, notes = read_calibration(*files)
    np.testing.assert_allclose(found.T_b_c, make_calibration().T_b_c, atol=1e-15)
    assert any("T_cam_imu (IMU to camera)" in note for note in notes)


def test_inverse_key_alone_maps_camera_to_imu(files: tuple[Path, Path]) -> None:
    change(files[0], "T_cam_imu", None, remove=True)
    found, notes = read_calibration(*files)
    np.testing.assert_array_equal(found.T_b_c, make_calibration().T_b_c)
    assert any("T_imu_cam (camera to IMU)" in note for note in notes)


def test_rounded_rotation_is_made_orthonormal(files: tuple[Path, Path]) -> None:
    change(files[0], "T_imu_cam", None, remove=True)
    change(files[0], "T_cam_imu", np.round(flip(make_calibration()), 4).tolist())
    found, notes = read_calibration(*files)
    R = found.T_b_c[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert any("made orthonormal" in note for note in notes)


def test_nested_imu_and_missing_timeshift(files: tuple[Path, Path]) -> None:
    files[1].write_text(yaml.safe_dump({"imu0": yaml.safe_load(files[1].read_text())}))
    change(files[0], "timeshift_cam_imu", None)
    found, notes = read_calibration(*files)
    assert found.noise == make_calibration().noise
    assert found.timeshift_ns == 0
    assert any("no file contains a time shift" in note for note in notes)


def test_exponents_without_a_dot_are_numbers(files: tuple[Path, Path]) -> None:
    files[1].write_text(files[1].read_text().replace("0.0005", "5e-4"))
    assert "5e-4" in files[1].read_text()
    found, _ = read_calibration(*files)
    assert found.noise == make_calibration().noise


_REFLECTION = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()
_SHEARED = (np.eye(4) + 0.01 * np.eye(4, k=1)).tolist()
_SHEARED[2][3] = 0.0


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("camera_model", "omni", "only 'pinhole' is supported"),
        ("distortion_model", "fov", "expected one of none, radtan, equidistant"),
        ("distortion_coeffs", [0.1, 0.2], "found 2 coefficients .* expected 4, 5, 8"),
        ("distortion_coeffs", "0.1", "expected a list of numbers"),
        ("intrinsics", [199.0, 199.0, 120.0], "expected a list of 4 numbers"),
        ("intrinsics", [-199.0, 199.0, 120.0, 90.0], "focal lengths are -199"),
        ("intrinsics", [0.8, 0.8, 1200.0, 900.0], "principal point"),
        ("intrinsics", [199.0, 199.0, float("nan"), 90.0], "expected a finite number"),
        ("intrinsics", [True, 199.0, 120.0, 90.0], "expected a number"),
        ("resolution", [240.5, 180], "expected 2 integers"),
        ("resolution", [0, 180], "resolution is 0 x 180"),
        ("timeshift_cam_imu", "soon", "expected a number"),
        ("timeshift_cam_imu", 1e12, "expected seconds"),
        ("T_cam_imu", np.eye(4).tolist(), "not inverse to each other"),
        ("T_imu_cam", _REFLECTION, "is a reflection"),
        ("T_imu_cam", _SHEARED, "not orthonormal"),
        ("T_imu_cam", np.eye(3).tolist(), "expected 4 rows of 4 numbers"),
        ("T_imu_cam", (2.0 * np.eye(4)).tolist(), "last row"),
        ("T_imu_cam", [[1, 0, 0, 46000], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "must be in metres"),
    ],
)
def test_impossible_camera_is_refused(files: tuple[Path, Path], key: str, value: Any, message: str) -> None:
    change(files[0], key, value)
    with pytest.raises(CalibrationError, match=message) as caught:
        read_calibration(*files)
    assert str(files[0]) in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("gyroscope_noise_density", 0.0, "expected a positive value"),
        ("accelerometer_random_walk", -1e-4, "expected a positive value"),
        ("accelerometer_noise_density", 1400.0, "expected a positive value"),
        ("gyroscope_random_walk", "fast", "expected a number"),
        ("update_rate", -200.0, "expected a positive rate"),
    ],
)
def test_impossible_noise_is_refused(files: tuple[Path, Path], key: str, value: Any, message: str) -> None:
    change(files[1], key, value)
    with pytest.raises(CalibrationError, match=message):
        read_calibration(*files)


@pytest.mark.parametrize("keys", [("T_cam_imu", "T_imu_cam"), ("intrinsics",), ("resolution",)])
def test_missing_camera_keys_are_named(files: tuple[Path, Path], keys: tuple[str, ...]) -> None:
    for key in keys:
        change(files[0], key, None, remove=True)
    with pytest.raises(CalibrationError, match=keys[0]):
        read_calibration(*files)


def test_missing_noise_key_is_named(files: tuple[Path, Path]) -> None:
    change(files[1], "accelerometer_noise_density", None, remove=True)
    with pytest.raises(CalibrationError, match="lacks the key accelerometer_noise_density"):
        read_calibration(*files)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("%YAML:1.0\ncam0: 1\n", "expected keys and values of a camera"),
        ("cam1: {}\n", "camera_model of cam1 is None"),
        ("- 1\n", "contains no keys with values, but a list"),
        ("cam0: [1,\n", "not valid YAML"),
        ("cam0: !!python/object/apply:os.system [exit]\n", "not valid YAML"),
        ("cam0: !!int ''\n", "not valid YAML"),
        ("[" * 900, "nested more than 32 levels"),
        ("[" * 5000, "brackets"),
        ("a: &a [1]\nb: [" + "*a," * 40 + "]\n", "aliases"),
        ("#" * 300_000, "larger than"),
    ],
)
def test_hostile_yaml_is_refused(files: tuple[Path, Path], text: str, message: str) -> None:
    files[0].write_text(text)
    with pytest.raises(CalibrationError, match=message):
        read_calibration(*files)


_SCALARS = st.one_of(st.none(), st.booleans(), st.floats(), st.integers(), st.text(max_size=8))
_VALUES = st.recursive(
    _SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.slow
@given(
    key=st.sampled_from(
        ["T_cam_imu", "T_imu_cam", "intrinsics", "resolution", "distortion_coeffs", "distortion_model",
         "camera_model", "timeshift_cam_imu", "update_rate", "gyroscope_noise_density"]
    ),
    value=_VALUES,
)  # fmt: skip
def test_any_value_gives_a_calibration_or_our_error(
    tmp_path_factory: pytest.TempPathFactory, key: str, value: Any
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    camchain, imu = folder / "c.yaml", folder / "i.yaml"
    write_camchain(camchain, make_calibration())
    write_imu_noise(imu, make_calibration().noise)
    target = imu if "rate" in key or "noise" in key else camchain
    change(target, key, value)
    valid_or_rejected(lambda: read_calibration(camchain, imu)[0], assert_valid_calibration)


@pytest.mark.parametrize("key", ["T_cam_imu", "camera_model", "resolution", "0x1" + "0" * 6000])
def test_integers_too_large_to_print_are_refused(files: tuple[Path, Path], key: str) -> None:
    enormous = "0x1" + "0" * 6000
    files[0].write_text(f"cam0:\n  camera_model: pinhole\n  resolution: [1, 1]\n  {key}: {enormous}\n")
    with pytest.raises(CalibrationError):
        read_calibration(*files)


@given(text=st.text(max_size=300))
def test_any_text_gives_our_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "c.yaml"
    path.write_text(text, encoding="utf-8", errors="replace")
    with pytest.raises(CalibrationError):
        read_calibration(path, path)
