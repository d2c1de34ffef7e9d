"""The intrinsics of a camera, as CameraInfo messages tell it."""

from __future__ import annotations

from pathlib import Path

from asyneio.errors import CalibrationError
from asyneio.io.calibration.intrinsics import distortion_named, make_intrinsics, without_zeros
from asyneio.io.ros.bag import Topic
from asyneio.io.ros.field_offsets import Located
from asyneio.io.ros.survey import Survey
from asyneio.types import CameraIntrinsics, Distortion

#: What ROS calls models that have another name here.
_NAMES = {"": "none", "fisheye": "equidistant"}


def intrinsics_of_camera_info(
    found: Survey, events: Topic, size: tuple[int, int] | None
) -> tuple[CameraIntrinsics | None, tuple[str, ...]]:
    """The intrinsics of the only CameraInfo of this size, or of that in the namespace of the events."""
    lenses: dict[Topic, CameraIntrinsics] = {}
    notes: list[str] = []
    for topic, (located, data) in found.cameras.items():
        try:
            intrinsics = _parse_camera_info(located, data, topic.name)
        except (CalibrationError, ValueError) as error:
            notes.append(f"{topic.name} was not taken for the intrinsics: {error}")
            continue
        if intrinsics is not None and size in (None, (intrinsics.width, intrinsics.height)):
            lenses[topic] = intrinsics
    space = events.name.rsplit("/", 1)[0]
    near = [topic for topic in lenses if topic.name.rsplit("/", 1)[0] == space]
    chosen = near if len(near) == 1 else list(lenses)
    if len({lenses[topic] for topic in chosen}) == 1:
        text = f"intrinsics of {chosen[0].name}, unless a file tells another; extrinsics and IMU noise need a file"
        return lenses[chosen[0]], (*notes, text)
    if chosen:
        names = ", ".join(topic.name for topic in chosen)
        notes.append(f"several lenses, none taken: {names}; give one with --calibration")
    return None, tuple(notes)


def _parse_camera_info(located: Located, data: bytes, name: str) -> CameraIntrinsics | None:
    """The intrinsics of a CameraInfo; None where it says that the camera is not calibrated."""
    upper = "K" in located.places
    k, d = (located.values(data, key if upper else key.lower()) for key in ("K", "D"))
    if not k[0]:
        return None
    model = located.text(data, "distortion_model").strip()
    distortion = distortion_named(_NAMES.get(model, model), Path(name), "distortion_model")
    # Drivers fill what was not fitted with zeros: a plumb_bob always has a third radial coefficient.
    coefficients = without_zeros(d.tolist()) if distortion is Distortion.RADTAN else tuple(d.tolist())
    if not any(coefficients):
        distortion, coefficients = Distortion.NONE, ()
    size = [located.number(data, side) for side in ("width", "height")]
    return make_intrinsics((k[0], k[4], k[2], k[5]), size, distortion, coefficients, Path(name))
