"""Files that lie beside a recording, and presets for what no file tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.cameras import PRESETS, Preset
from asyneio.errors import CalibrationError, ConfigError
from asyneio.io import ReadOptions, open_recording, write_uzh_folder
from asyneio.io.calibration import (
    CalibrationSelection,
    CalibrationSources,
    IncompleteCalibration,
    find_calibration,
    require_calibration,
)
from asyneio.types import Calibration, EventRecording, ImuNoise
from tests.io.calibration.rigs import RATE_HZ, basalt, kalibr, make_rig, openvins, rpg, vins_fusion
from tests.io.calibration.test_kinds import SIZE, assert_same
from tests.io.event_recordings import make_event_recording


def resolve(
    sources: CalibrationSources, size: tuple[int, int] | None = SIZE, rate_hz: float | None = None
) -> tuple[Calibration, tuple[str, ...]]:
    """The resolved calibration, which must be complete, and its notes."""
    found, notes = sources.resolve(size, rate_hz=rate_hz)
    assert isinstance(found, Calibration)
    return found, notes


def test_files_are_found_by_their_content(tmp_path: Path) -> None:
    rig = make_rig()
    for index, write in enumerate((openvins, rpg, vins_fusion, basalt, kalibr)):
        folder = tmp_path / str(index)
        write(folder, rig)
        (folder / "config.yaml").write_text("window: {length_s: 1.5}\n")
        (folder / "broken.json").write_text("{")
        found, notes = resolve(find_calibration(folder, None, None), rate_hz=RATE_HZ)
        assert_same(found, rig)
        assert any("found next to the recording" in note for note in notes)


def test_several_calibrations_are_ambiguous(tmp_path: Path) -> None:
    rig = make_rig()
    rpg(tmp_path, rig)
    basalt(tmp_path, rig)
    found, notes = find_calibration(tmp_path, None, None).resolve(SIZE)
    assert isinstance(found, IncompleteCalibration)
    assert found.camera is None
    assert any("(calibration.json, rig.yaml): select one with --calibration" in note for note in notes)
    resolve(find_calibration(tmp_path, tmp_path / "rig.yaml", None))


def test_a_found_calibration_may_be_of_another_camera(tmp_path: Path) -> None:
    rpg(tmp_path, make_rig())
    found, notes = find_calibration(tmp_path, None, None).resolve((640, 480))
    assert found.camera is None
    assert any("rig.yaml is for 240 x 180 pixels: not used" in note for note in notes)


def test_precedence_of_names_and_noise(tmp_path: Path) -> None:
    """Kalibr's file names come before other names, a given file with noise before both."""
    rig = make_rig()
    rpg(tmp_path, replace(rig, timeshift_ns=0))
    camera, imu = kalibr(tmp_path, rig)
    assert imu is not None
    camera.rename(tmp_path / "camchain-imucam.yaml")
    imu.rename(tmp_path / "imu.yaml")
    assert_same(resolve(find_calibration(tmp_path, None, None))[0], rig)
    other = replace(rig, noise=replace(rig.noise, gyroscope_density=1e-3))
    named = rpg(tmp_path / "other", other)[0]
    found, _ = resolve(find_calibration(tmp_path, named, None))
    assert found.noise.gyroscope_density == 1e-3
    found, _ = resolve(find_calibration(tmp_path, named, tmp_path / "imu.yaml"))
    assert found.noise == rig.noise


def test_incomplete_calibration_names_what_is_missing(tmp_path: Path) -> None:
    imu = kalibr(tmp_path, make_rig())[1]
    assert imu is not None
    found, notes = find_calibration(tmp_path / "absent", None, imu).resolve(SIZE)
    assert isinstance(found, IncompleteCalibration)
    assert found.reason == notes[-1]
    assert "no intrinsics and no extrinsics" in found.reason
    with pytest.raises(CalibrationError, match=r"no complete calibration: .*no intrinsics and no extrinsics"):
        require_calibration(found, tmp_path)


def test_folders_full_of_yaml(tmp_path: Path) -> None:
    for index in range(70):
        (tmp_path / f"{index}.yaml").write_text("a: 1\n")
    assert "not searched for a calibration" in find_calibration(tmp_path, None, None).notes[0]
    assert find_calibration(tmp_path / "absent", None, None) == CalibrationSources()


@pytest.mark.parametrize("found", PRESETS.values(), ids=PRESETS.keys())
def test_presets_are_whole(found: Preset) -> None:
    for part, source in (("noise", "noise"), ("intrinsics", "intrinsics"), ("T_b_c", "extrinsics")):
        assert (getattr(found, part) is None) == (source not in found.sources)
    assert (found.T_b_c is None) == bool(found.missing)
    if found.noise is not None:
        # Densities of small MEMS units lie within these bounds.
        assert 5e-5 < found.noise.gyroscope_density < 5e-4
        assert 1e-3 < found.noise.accelerometer_density < 1e-2
    if found.T_b_c is not None:
        R = found.T_b_c[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(R) > 0.0
        assert np.linalg.norm(found.T_b_c[:3, 3]) < 0.1
    if found.intrinsics is not None:
        assert (found.intrinsics.width, found.intrinsics.height) == found.size


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    """The layout of the data set: no extrinsics, no noise."""
    recording = make_event_recording(rng)
    assert recording.camera is not None
    write_uzh_folder(replace(recording, calibration=None), tmp_path)
    (tmp_path / "camchain-imucam.yaml").unlink()
    return tmp_path


def test_a_preset_fills_in_what_is_missing(folder: Path) -> None:
    assert open_recording(folder).calibration is None
    found = open_recording(folder, ReadOptions(preset="davis240c"))
    assert isinstance(found, EventRecording)
    preset = PRESETS["DAVIS240C"]
    assert found.calibration is not None
    assert preset.T_b_c is not None
    # The lens is that of calib.txt, not the preset's.
    assert found.calibration.camera.fx == 199.1
    np.testing.assert_allclose(found.calibration.T_b_c, preset.T_b_c, atol=1e-9)
    assert (found.calibration.noise, found.calibration.timeshift_ns) == (preset.noise, 2_400_000)
    for what in ("extrinsics", "time shift", "noise"):
        assert any(note.startswith(f"{what} of the preset DAVIS240C: ") for note in found.notes)
    (folder / "calib.txt").unlink()
    found = open_recording(folder, ReadOptions(preset="DAVIS240C"))
    assert found.calibration is not None
    assert found.calibration.camera == preset.intrinsics


def test_a_preset_tells_the_size(folder: Path) -> None:
    """Events as text tell no size, and would be taken for the smallest usual sensor that holds them."""
    (folder / "calib.txt").unlink()
    assert (open_recording(folder).width, open_recording(folder).height) == (240, 180)
    found = open_recording(folder, ReadOptions(preset="DAVIS346"))
    assert (found.width, found.height, found.camera) == (346, 260, None)
    assert not any("sensor size not in any file" in note for note in found.notes)


def test_files_go_before_a_preset(folder: Path, tmp_path: Path) -> None:
    (folder / "imu.yaml").write_text(
        "gyroscope_noise_density: 1e-3\naccelerometer_noise_density: 1e-2\n"
        "gyroscope_random_walk: 1e-5\naccelerometer_random_walk: 1e-4\n"
    )
    found = open_recording(folder, ReadOptions(preset="DAVIS240C"))
    assert found.calibration is not None
    assert found.calibration.noise == ImuNoise(1e-3, 1e-2, 1e-5, 1e-4)


def test_presets_that_do_not_fit(folder: Path) -> None:
    davis346 = CalibrationSelection(preset="DAVIS346")
    with pytest.raises(CalibrationError, match="DAVIS346 has 346 x 260 pixels, the recording 240 x 180"):
        CalibrationSources().resolve(SIZE, davis346)
    with pytest.raises(ConfigError, match="preset 'DVS128' is unknown; expected one of DAVIS240C"):
        open_recording(folder, ReadOptions(preset="DVS128"))
    camera = replace(make_rig().camera, width=346, height=260)
    found, notes = CalibrationSources().resolve((346, 260), davis346, lambda width, height: camera)
    assert found == IncompleteCalibration(camera, notes[-1])
    assert "no extrinsics (camera to IMU): extrinsics differ between units and are not published" in notes[-1]
