"""Files that lie beside calibrations and are none, known by name: what they are, and what to give instead."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError

_KALIBR = (
    "{path} is Kalibr's report in text; expected the calibration itself: give {there}, which Kalibr writes "
    "beside it"
)
#: Beginnings of texts, and what is to be done.
_TEXTS = {
    "Calibration results": _KALIBR,
    "Camera-system parameters": _KALIBR,
    "%PDF": "{path} is a report in PDF; expected the calibration itself: give {there}, which Kalibr "
    "writes beside it",
    "# oST version": "{path} is the text of ROS' camera calibrator; expected its YAML: give ost.yaml, "
    "written with it",
}
_CAMERA_KEYS = (
    "camera_model",
    "intrinsics",
    "distortion_model",
    "distortion_coeffs",
    "resolution",
    "T_cam_imu",
)


class KnownFileError(CalibrationError):
    """A file that is known and not read; the message says what to give instead."""


def reject_known_text(text: str, path: Path) -> None:
    """Raises KnownFileError: the text is a report."""
    for start, message in _TEXTS.items():
        if text.lstrip().startswith(start):
            chains = sorted(file.name for file in path.parent.glob("*chain*.yaml"))
            raise KnownFileError(
                message.format(path=path, there=chains[0] if chains else "camchain-imucam-*.yaml")
            )


def reject_known_keys(content: dict[str, Any], path: Path) -> None:
    """Raises KnownFileError: the keys are of no calibration, or stand one level too high."""
    if "Gyr" in content and "Acc" in content:
        raise KnownFileError(f"{path} is a result of imu_utils: {_imu_utils(content)}")
    if "target_type" in content:
        raise KnownFileError(
            f"{path} describes a calibration target ({content['target_type']}); expected the calibration "
            "that Kalibr "
            "made with it: camchain-imucam-*.yaml"
        )
    empty = next((key for key, value in content.items() if key.startswith("cam") and value is None), None)
    flat = [key for key in _CAMERA_KEYS if key in content]
    if flat and (empty or not any(isinstance(value, dict) for value in content.values())):
        raise KnownFileError(
            f"{path}: the keys {', '.join(flat)} stand at the left margin; expected them below "
            f"{empty or 'cam0'}:, "
            "indented by two blanks each"
        )


def _imu_utils(content: dict[str, Any]) -> str:
    """What to write instead, with the figures of the file where they are there."""
    figures = {}
    for sensor, letter in (("Gyr", "gyr"), ("Acc", "acc")):
        section = content[sensor].get("avg-axis") if isinstance(content[sensor], dict) else None
        for figure in ("n", "w"):
            value = section.get(f"{letter}_{figure}") if isinstance(section, dict) else None
            figures[f"{letter}_{figure}"] = f"{value} ({letter}_{figure})" if value else f"{letter}_{figure}"
    return (
        "its noise figures are those of a sample; expected densities. Write a file imu.yaml with "
        f"gyroscope_noise_density: {figures['gyr_n']} divided by the root of the IMU's rate in Hz, "
        f"accelerometer_noise_density: {figures['acc_n']} divided likewise, gyroscope_random_walk: "
        f"{figures['gyr_w']}, accelerometer_random_walk: {figures['acc_w']}, update_rate: the rate; and "
        "give it with "
        "--imu"
    )
