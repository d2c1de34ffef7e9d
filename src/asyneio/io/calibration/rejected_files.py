# SPDX-License-Identifier: Apache-2.0
"""Files that are often mistaken for calibrations: what they are, and which file to use instead."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError

_KALIBR = (
    "{path} is a text report of Kalibr; expected the calibration: use {there}, which Kalibr writes to "
    "the same folder"
)
#: First words of a text, and the message for it.
_TEXTS = {
    "Calibration results": _KALIBR,
    "Camera-system parameters": _KALIBR,
    "%PDF": "{path} is a PDF report; expected the calibration: use {there}, which Kalibr writes to the "
    "same folder",
    "MATLAB": "{path} is a MATLAB file; expected YAML: write its values to camchain.yaml below cam0: as "
    "Kalibr does",
    "# oST version": "{path} is the text output of the ROS camera calibrator; expected its YAML: use "
    "ost.yaml from the same folder",
}
_DSO = (
    "{path} is a camera file of DSO; expected YAML: write the values to camchain.yaml below cam0: as "
    "camera_model: pinhole, intrinsics: [fx, fy, cx, cy], distortion_model: radtan (or equidistant), "
    "distortion_coeffs: [k1, k2, p1, p2], resolution: [width, height]"
)
_TEXTS |= dict.fromkeys(("RadTan ", "EquiDistant ", "Pinhole ", "FOV ", "KannalaBrandt "), _DSO)
_CAMERA_KEYS = (
    "camera_model",
    "intrinsics",
    "distortion_model",
    "distortion_coeffs",
    "resolution",
    "T_cam_imu",
)


class KnownFileError(CalibrationError):
    """A known file that is not a calibration; the message says which file to use instead."""


def reject_known_text(text: str, path: Path) -> None:
    """Raises KnownFileError if the text is a report."""
    for start, message in _TEXTS.items():
        if text.lstrip().startswith(start):
            chains = sorted(file.name for file in path.parent.glob("*chain*.yaml"))
            raise KnownFileError(
                message.format(path=path, there=chains[0] if chains else "camchain-imucam-*.yaml")
            )


def reject_known_keys(content: dict[str, Any], path: Path) -> None:
    """Raises KnownFileError if the keys belong to another kind of file, or are one level too high."""
    if "Gyr" in content and "Acc" in content:
        raise KnownFileError(f"{path} is an output of imu_utils: {_imu_utils(content)}")
    if "target_type" in content:
        raise KnownFileError(
            f"{path} describes a calibration target ({content['target_type']}); expected the calibration "
            "that Kalibr computes with it: camchain-imucam-*.yaml"
        )
    cameras = content.get("cameras")
    if isinstance(cameras, list) and cameras and isinstance(cameras[0], dict) and "T_SC" in cameras[0]:
        raise KnownFileError(
            f"{path} is a configuration of OKVIS; expected a Kalibr chain: write T_SC below cam0: as "
            "T_imu_cam, focal_length and principal_point as intrinsics: [fx, fy, cx, cy], with "
            "camera_model: pinhole, distortion_model, distortion_coeffs and resolution"
        )
    empty = next((key for key, value in content.items() if key.startswith("cam") and value is None), None)
    flat = [key for key in _CAMERA_KEYS if key in content]
    if flat and (empty or not any(isinstance(value, dict) for value in content.values())):
        raise KnownFileError(
            f"{path}: the keys {', '.join(flat)} are not indented; expected them below {empty or 'cam0'}:, "
            "indented by two blanks"
        )


def _imu_utils(content: dict[str, Any]) -> str:
    """What to write instead, with the values of the file if it contains them."""
    values = {}
    for sensor, letter in (("Gyr", "gyr"), ("Acc", "acc")):
        section = content[sensor].get("avg-axis") if isinstance(content[sensor], dict) else None
        for quantity in ("n", "w"):
            value = section.get(f"{letter}_{quantity}") if isinstance(section, dict) else None
            name = f"{letter}_{quantity}"
            values[name] = f"{value} ({name})" if value else name
    return (
        "its noise values are per sample; expected densities. Write a file imu.yaml with "
        f"gyroscope_noise_density: {values['gyr_n']} divided by the square root of the IMU rate in Hz, "
        f"accelerometer_noise_density: {values['acc_n']} divided by the same, gyroscope_random_walk: "
        f"{values['gyr_w']}, accelerometer_random_walk: {values['acc_w']}, update_rate: the rate; pass it "
        "with --imu"
    )
