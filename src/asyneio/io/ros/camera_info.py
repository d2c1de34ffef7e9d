# SPDX-License-Identifier: Apache-2.0
"""Camera intrinsics from CameraInfo messages."""

from __future__ import annotations

from pathlib import Path

from asyneio.errors import CalibrationError
from asyneio.io.calibration.intrinsics import distortion_named, make_intrinsics, without_zeros
from asyneio.io.ros.bag import Topic
from asyneio.io.ros.field_offsets import MessageLayout
from asyneio.io.ros.survey import Survey
from asyneio.types import CameraIntrinsics, Distortion

#: Distortion models with another name in ROS.
_NAMES = {"": "none", "fisheye": "equidistant"}


def intrinsics_of_camera_info(
    found: Survey, events: Topic, size: tuple[int, int] | None
) -> tuple[CameraIntrinsics | None, tuple[str, ...]]:
    """Intrinsics from the only CameraInfo with this size, or from the one in the namespace of the events."""
    candidates: dict[Topic, CameraIntrinsics] = {}
    notes: list[str] = []
    for topic, (layout, data) in found.cameras.items():
        try:
            intrinsics = _parse_camera_info(layout, data, topic.name)
        except (CalibrationError, ValueError) as error:
            notes.append(f"{topic.name} is not used for the intrinsics: {error}")
            continue
        if intrinsics is not None and size in (None, (intrinsics.width, intrinsics.height)):
            candidates[topic] = intrinsics
    space = events.name.rsplit("/", 1)[0]
    near = [topic for topic in candidates if topic.name.rsplit("/", 1)[0] == space]
    chosen = near if len(near) == 1 else list(candidates)
    if len({candidates[topic] for topic in chosen}) == 1:
        notes.append(
            f"intrinsics from {chosen[0].name}, unless a file contains others; extrinsics and IMU noise "
            "need a file"
        )
        return candidates[chosen[0]], tuple(notes)
    if chosen:
        names = ", ".join(topic.name for topic in chosen)
        notes.append(f"several CameraInfo topics, none used: {names}; select intrinsics with --calibration")
    return None, tuple(notes)


def _parse_camera_info(layout: MessageLayout, data: bytes, name: str) -> CameraIntrinsics | None:
    """The intrinsics of a CameraInfo; None if the camera is not calibrated."""
    upper = "K" in layout.fields
    k, d = (layout.values(data, key if upper else key.lower()) for key in ("K", "D"))
    if not k[0]:
        return None
    model = layout.text(data, "distortion_model").strip()
    distortion = distortion_named(_NAMES.get(model, model), Path(name), "distortion_model")
    # Drivers write zeros for unfitted coefficients: a plumb_bob always has a third radial one.
    coefficients = without_zeros(d.tolist()) if distortion is Distortion.RADTAN else tuple(d.tolist())
    if not any(coefficients):
        distortion, coefficients = Distortion.NONE, ()
    size = [layout.number(data, side) for side in ("width", "height")]
    return make_intrinsics((k[0], k[4], k[2], k[5]), size, distortion, coefficients, Path(name))
