"""One rig in every kind of file is one calibration; what no kind may hold is refused in words."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.errors import CalibrationError
from asyneio.io import read_calibration
from asyneio.io.calibration import (
    CalibrationSelection,
    IncompleteCalibration,
    find_calibration,
    open_calibration,
    read_imu_noise,
)
from asyneio.types import Calibration, Distortion, ImuNoise
from tests.io.calibration.rigs import (
    KINDS,
    RATE_HZ,
    basalt,
    kalibr,
    make_rig,
    openvins,
    rpg,
    vins_fusion,
    vins_mono,
)
from tests.io.validity import assert_valid_calibration, valid_or_rejected

SIZE = (240, 180)


def assert_same(found: Calibration, wanted: Calibration, shifted: bool = True) -> None:
    """Equal up to the rounding of an inverse or of a quaternion."""
    assert found.camera == wanted.camera
    np.testing.assert_allclose(found.T_b_c, wanted.T_b_c, rtol=0.0, atol=1e-12)
    assert found.timeshift_ns == (wanted.timeshift_ns if shifted else 0)
    for name in ("gyroscope_density", "accelerometer_density", "gyroscope_walk", "accelerometer_walk"):
        assert getattr(found.noise, name) == pytest.approx(getattr(wanted.noise, name), rel=1e-12)


@pytest.mark.parametrize("distortion", list(Distortion))
@pytest.mark.parametrize("kind", KINDS)
def test_one_rig_in_every_kind(tmp_path: Path, kind: str, distortion: Distortion) -> None:
    rig = make_rig(distortion)
    camera, imu = KINDS[kind](tmp_path, rig)
    found, notes = read_calibration(camera, imu, size=SIZE, rate_hz=RATE_HZ)
    assert_same(found, rig, shifted=kind != "euroc")
    assert found.noise.rate_hz == (None if "vins-" in kind else RATE_HZ)
    assert any("extrinsics" in note for note in notes)


_ANGLES = st.floats(-3.0, 3.0)
_LENGTHS = st.floats(-0.9, 0.9)


@settings(max_examples=15)
@given(
    kind=st.sampled_from(sorted(KINDS)),
    rotation=st.tuples(_ANGLES, _ANGLES, _ANGLES),
    translation=st.tuples(_LENGTHS, _LENGTHS, _LENGTHS),
    shift_us=st.integers(-(10**6), 10**6),
)
def test_any_rig_in_any_kind(
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
    rotation: tuple[float, float, float],
    translation: tuple[float, float, float],
    shift_us: int,
) -> None:
    rig = make_rig(Distortion.RADTAN, np.array(rotation), translation, 1000 * shift_us)
    camera, imu = KINDS[kind](tmp_path_factory.mktemp("rig"), rig)
    found, _ = read_calibration(camera, imu, size=SIZE, rate_hz=RATE_HZ)
    assert_same(found, rig, shifted=kind != "euroc")


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("kalibr", "read from T_cam_imu (IMU to camera) and inverted"),
        ("openvins", "read from T_imu_cam (camera to IMU)"),
        ("rpg", "read from T_B_C (camera to body)"),
        ("vins-mono", "read from extrinsicRotation, extrinsicTranslation (camera to body)"),
        ("vins-fusion", "read from body_T_cam0 (camera to body)"),
        ("basalt", "extrinsics of cam1 read from T_imu_cam (camera to IMU)"),
        ("euroc", "read from T_BS (sensor to body)"),
    ],
)
def test_the_convention_is_said(tmp_path: Path, kind: str, said: str) -> None:
    camera, imu = KINDS[kind](tmp_path, make_rig())
    _, notes = read_calibration(camera, imu, size=SIZE)
    assert any(said in note for note in notes)


def test_per_sample_noise_needs_the_rate(tmp_path: Path) -> None:
    rig = make_rig()
    camera, _ = vins_mono(tmp_path, rig)
    guessed, notes = read_calibration(camera)
    assert guessed.noise.gyroscope_density == pytest.approx(
        rig.noise.gyroscope_density * np.sqrt(RATE_HZ / 200)
    )
    assert any("assumed for the noise densities: 200 Hz" in note for note in notes)
    _, notes = read_calibration(camera, rate_hz=RATE_HZ)
    assert any("measured for the noise densities: 250 Hz" in note for note in notes)


def test_the_lens_alone(tmp_path: Path) -> None:
    lens = make_rig().camera
    section = (
        f"    camera_model: pinhole\n    camera_matrix: [{lens.fx}, {lens.fy}, {lens.cx}, {lens.cy}]\n"
        f"    distortion_coeffs: {list(lens.coefficients)}\n    distortion_model: radtan\n"
    )
    dsec = "intrinsics:\n" + "".join(
        f"  {name}:\n{section}    resolution: [{width}, {height}]\n"
        for name, width, height in (("cam0", 240, 180), ("cam1", 1440, 1080), ("camRect0", 240, 180))
    )
    ros = (
        f"image_width: 240\nimage_height: 180\ncamera_name: davis\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: [{lens.fx}, 0, {lens.cx}, 0, {lens.fy}, {lens.cy}, 0, 0, 1]\ndistortion_model: plumb_bob\n"
        f"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: {[*lens.coefficients, 0.0]}\n"
    )
    for name, text, coefficients in (
        ("cam_to_cam.yaml", dsec, lens.coefficients),
        ("info.yaml", ros, (*lens.coefficients, 0.0)),
    ):
        path = tmp_path / name
        path.write_text(text)
        found, notes = find_calibration(tmp_path, path, None).resolve(SIZE)
        assert isinstance(found, IncompleteCalibration)
        assert found.camera == replace(lens, coefficients=coefficients)
        assert "the calibration is incomplete: no extrinsics (camera to IMU) and no IMU noise" in notes
        with pytest.raises(CalibrationError, match="no complete calibration"):
            read_calibration(path, size=SIZE)


def test_cameras_are_chosen(tmp_path: Path) -> None:
    rig = make_rig(Distortion.EQUIDISTANT)
    camera, _ = basalt(tmp_path, rig)
    assert_same(read_calibration(camera, selection=CalibrationSelection("cam1"))[0], rig)
    assert [str(entry) for entry in open_calibration(camera).cameras] == [
        "cam0 (752 x 480)",
        "cam1 (240 x 180)",
    ]
    for size, wanted, message in (
        (None, None, r"2 cameras and the sensor size is unknown: cam0 \(752 x 480\); cam1"),
        ((640, 480), None, "2 cameras, none of 640 x 480 pixels.*pass the calibration of this camera"),
        (
            SIZE,
            CalibrationSelection("cam2"),
            "no cameras match 'cam2', expected one; the calibration contains cam0",
        ),
        (SIZE, CalibrationSelection("cam0"), "camera_type of cam0 is 'ds'; supported: pinhole, kb4"),
    ):
        with pytest.raises(CalibrationError, match=message):
            read_calibration(camera, selection=wanted, size=size)


def test_a_camera_is_chosen_by_topic(tmp_path: Path) -> None:
    rig = make_rig()
    camera, imu = KINDS["kalibr, second of two"](tmp_path, rig)
    for name in ("/dvs/image_raw", "dvs"):
        assert_same(read_calibration(camera, imu, CalibrationSelection(name))[0], rig)
    with pytest.raises(CalibrationError, match="2 cameras match 'image_raw', expected one"):
        read_calibration(camera, imu, CalibrationSelection("image_raw"))


def _replaced(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("kind", "old", "new", "message"),
    [
        ("rpg", "type: pinhole", "type: omni", "the type of dvs is 'omni'; only 'pinhole'"),
        ("rpg", "radial-tangential", "fisheye", "expected one of none, radtan, equidistant"),
        ("rpg", "rows: 4\n    data", "rows: 3\n    data", "T_B_C is 3 x 4; expected 4 x 4"),
        (
            "rpg",
            "sigma_acc_c: 0.0014",
            "sigma_acc_c: 1400",
            "sigma_acc_c is 1400; expected a positive",
        ),
        ("rpg", "image_width: 240", "image_width: wide", "image_width contains 'wide'; expected a number"),
        ("rpg", "- camera:", "- lens:", "entry 0 of cameras contains no 'camera'"),
        ("rpg", "image_height: 180", "image_height: 0x1" + 5000 * "0", "expected a finite number"),
        ("vins-mono", "PINHOLE", "MEI", "model_type is 'MEI'; supported: PINHOLE and KANNALA_BRANDT"),
        ("vins-mono", "estimate_extrinsic: 0", "estimate_extrinsic: 2", "the extrinsics are unknown"),
        ("vins-mono", "!!opencv-matrix", "!!opencv-matrix [1]\nx:", "not valid YAML"),
        ("vins-mono", "acc_n:", "acc_m:", "lacks the key acc_n"),
        ("vins-mono", "td: ", "td: 1e30 # ", "td is 1e\\+30; expected seconds"),
        ("vins-fusion", '"cam0_pinhole.yaml"', '"../secret.yaml"', "outside its folder"),
        ("vins-fusion", '"cam0_pinhole.yaml"', '"/etc/passwd"', "outside its folder"),
        ("vins-fusion", '"cam0_pinhole.yaml"', '"absent.yaml"', "cannot read the calibration .*absent.yaml"),
        ("vins-fusion", '"cam0_pinhole.yaml"', "[1]", "does not name a file"),
        ("openvins", '"kalibr_imu_chain.yaml"', '"../imu.yaml"', "outside its folder"),
        ("basalt", '"pinhole-radtan8"', '"eucm"', "camera_type of cam1 is 'eucm'"),
        ("basalt", '"k4": 0.0', '"k4": 1e9', "found distortion coefficients .* finite numbers up to"),
        ("basalt", '"cam_time_offset_ns": 2400000', '"cam_time_offset_ns": 1e30', "expected nanoseconds"),
        ("basalt", '"T_imu_cam": [', '"T_imu_cam": [], "old": [', "T_imu_cam has 0 entries"),
        ("basalt", '"T_imu_cam": [', '"T_imu_cam": 3, "old": [', "T_imu_cam is 3; expected a list"),
        ("euroc", "camera_model: pinhole", "camera_model: ds", "only 'pinhole' is supported"),
        ("kalibr", "radtan", "equidistant\n  resolutoin: 1\n  distortion_model: fov", "expected one of none"),
    ],
)
def test_unsupported_content_is_named(tmp_path: Path, kind: str, old: str, new: str, message: str) -> None:
    camera, imu = KINDS[kind](tmp_path, make_rig())
    _replaced(camera, old, new)
    with pytest.raises(CalibrationError, match=message) as caught:
        read_calibration(camera, imu, size=SIZE)
    assert str(tmp_path) in str(caught.value)


def test_rigid_transforms_are_checked(tmp_path: Path) -> None:
    rig = make_rig()
    reflected, scaled, far, doubtful = (rig.T_b_c.copy() for _ in range(4))
    reflected[:3, 2] *= -1.0
    scaled[:3, :3] *= 1.01
    far[:3, 3] *= 1000.0
    doubtful[:3, 3] = [1.4, 0.0, 0.0]
    for T, message in (
        (reflected, r"reflection \(det = -1, expected \+1\).*cross product"),
        (scaled, "not orthonormal.*it is not scaled"),
        (far, "34.2 m apart; the translation must be in metres: divide by 1000"),
    ):
        for write in (rpg, vins_fusion, kalibr):
            with pytest.raises(CalibrationError, match=message if write is not kalibr else "."):
                read_calibration(*write(tmp_path, replace(rig, T_b_c=T)))
    found, notes = read_calibration(*rpg(tmp_path, replace(rig, T_b_c=doubtful)))
    np.testing.assert_array_equal(found.T_b_c, doubtful)
    assert any("1.4 m apart; is its translation in metres?" in note for note in notes)


def test_quaternions_are_checked(tmp_path: Path) -> None:
    camera, _ = basalt(tmp_path, make_rig())
    content = json.loads(camera.read_text())
    content["value0"]["T_imu_cam"][1]["qw"] = 2.0
    camera.write_text(json.dumps(content))
    with pytest.raises(CalibrationError, match=r"quaternion of T_imu_cam of cam1 has length 2\."):
        read_calibration(camera, size=SIZE)


def test_corrections_of_the_imu_are_not_hidden(tmp_path: Path) -> None:
    camera, _ = basalt(tmp_path, make_rig())
    assert not any("misalignment" in note for note in read_calibration(camera, size=SIZE)[1])
    content = json.loads(camera.read_text())
    content["value0"]["calib_gyro_bias"][5] = -0.02
    camera.write_text(json.dumps(content))
    _, notes = read_calibration(camera, size=SIZE)
    assert any("up to 0.02; they are not applied" in note for note in notes)


@pytest.mark.parametrize(
    "text",
    [
        "  Tw:\n    - [1.0, 0.0, 0.0]\n    - [0.01, 1.0, 0.0]\n    - [0.0, 0.0, 1.0]\n",
        "  Tg:\n    - [0.0, 1.0e-4, 0.0]\n    - [0.0, 0.0, 0.0]\n    - [0.0, 0.0, 0.0]\n",
        "  gyroscopes:\n    M: [[1.02, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n",
    ],
)
def test_corrections_in_an_imu_file_are_not_hidden(tmp_path: Path, text: str) -> None:
    camera, _ = openvins(tmp_path, make_rig())
    assert not any("not applied" in note for note in read_calibration(camera)[1])
    path = tmp_path / "kalibr_imu_chain.yaml"
    path.write_text(path.read_text() + text)
    assert any("correct IMU samples; they are not applied" in note for note in read_calibration(camera)[1])


def test_distortion_that_folds(tmp_path: Path) -> None:
    rig = make_rig()
    folding = replace(rig.camera, coefficients=(-1.2, 0.0, 0.0, 0.0))
    with pytest.raises(CalibrationError, match=r"folds inside the image: .*often exchanged"):
        read_calibration(*kalibr(tmp_path, replace(rig, camera=folding)))
    # The equidistant lens of a wide camera under the wrong name.
    mistaken = replace(rig.camera, coefficients=(0.01, -0.02, 0.07, -0.08))
    _, notes = read_calibration(*kalibr(tmp_path, replace(rig, camera=mistaken)))
    assert any("is the distortion equidistant, not radtan?" in note for note in notes)
    corners = replace(rig.camera, coefficients=(-0.36, 0.0, 0.0, 0.0))
    _, notes = read_calibration(*kalibr(tmp_path, replace(rig, camera=corners)))
    assert any("of the image has no viewing direction" in note for note in notes)


def test_json_that_is_hostile(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    for text, message in (
        ("{" * 100_000, "JSON"),
        ('{"a": ' * 2000, "brackets|JSON|YAML"),
        ('{"value0": {"intrinsics": 1' + "0" * 5000 + "}}", "JSON|YAML|expected a list"),
        ('{"a": "' + "x" * 2**20 + '"}', "larger than 1024 KiB"),
        ('{"value0": {"intrinsics": [{}]}}', "intrinsics is None; expected a mapping|resolution"),
        ('{"value0": {}}', "calibration format; found the keys value0"),
        ("{}", "found the keys none"),
    ):
        path.write_text(text)
        with pytest.raises(CalibrationError, match=message):
            read_calibration(path)


_VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), st.floats(), st.integers(), st.text(max_size=6)),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from("abk"), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=60)
@given(data=st.data(), value=_VALUES)
def test_any_value_at_any_place_gives_a_calibration_or_our_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, value: object
) -> None:
    camera, _ = basalt(tmp_path_factory.mktemp("fuzz"), make_rig(Distortion.EQUIDISTANT))
    content = json.loads(camera.read_text())
    section = content["value0"]
    key = data.draw(st.sampled_from(sorted(section)))
    inner = section[key]
    if isinstance(inner, list) and len(inner) > 1 and data.draw(st.booleans()):
        inner[1] = value
    else:
        section[key] = value
    camera.write_text(json.dumps(content))
    valid_or_rejected(lambda: read_calibration(camera, size=SIZE)[0], assert_valid_calibration)


_HOSTILE = (
    "", "[]", "{}", "null", "true", "x", "-1", "0", "1e999", ".nan", "0x1" + "0" * 5000, "[[1]]",
    "!!opencv-matrix [1]", "!!opencv-matrix {rows: 1}", "&a [*a]", "!!binary x", "2001-01-01", "'",
    "../x.yaml",
    "{rows: [1], cols: {}, data: 3}", "[1, 2, 3, x]", "!!python/object/apply:os.system [exit]",
)  # fmt: skip


@pytest.mark.slow
@settings(max_examples=150)
@given(
    kind=st.sampled_from(sorted(set(KINDS) - {"basalt"})),
    line=st.integers(0, 200),
    value=st.sampled_from(_HOSTILE),
    whole=st.booleans(),
)
def test_any_line_may_be_hostile(
    tmp_path_factory: pytest.TempPathFactory, kind: str, line: int, value: str, whole: bool
) -> None:
    """A line's value, or the line with all that is below it, replaced in any of the files."""
    folder = tmp_path_factory.mktemp("fuzz")
    camera, imu = KINDS[kind](folder, make_rig())
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    path = files[line % len(files)]
    lines = path.read_text().splitlines()
    index = line % len(lines)
    key = lines[index].split(":", 1)[0]
    below = index + 1
    while whole and below < len(lines) and lines[below].startswith(" " * (len(key) - len(key.lstrip()) + 1)):
        below += 1
    lines[index:below] = [f"{key}: {value}"]
    path.write_text("\n".join(lines) + "\n")
    valid_or_rejected(lambda: read_calibration(camera, imu, size=SIZE)[0], assert_valid_calibration)


def test_real_files(data_dir: Path) -> None:
    tum, notes = read_calibration(
        data_dir / "tumvi_calib" / "camchain-imucam.yaml", data_dir / "tumvi_calib" / "imu.yaml"
    )
    assert (tum.camera.width, tum.timeshift_ns, tum.noise.rate_hz) == (384, 375_000, 199.4)
    assert any("T_cam_imu (IMU to camera) and inverted" in note for note in notes)
    noise = read_imu_noise(data_dir / "euroc_V1_01" / "imu0_sensor.yaml")
    assert noise == ImuNoise(1.6968e-4, 2e-3, 1.9393e-5, 3e-3, 200.0)
    with pytest.raises(CalibrationError, match="without a camera; expected intrinsics and extrinsics"):
        read_calibration(data_dir / "euroc_V1_01" / "imu0_sensor.yaml")
