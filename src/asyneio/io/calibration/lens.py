"""A lens out of a calibration file, checked: size, focal lengths, distortion that can be undone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from asyneio.errors import CalibrationError, GeometryError
from asyneio.geometry import distortion
from asyneio.io.calibration.values import integers, numbers, shown
from asyneio.types import CameraIntrinsics, Distortion

MAX_PIXELS = 100_000

#: The distortion models by the names that the various tools give them.
DISTORTION_NAMES = {
    "none": Distortion.NONE,
    "radtan": Distortion.RADTAN,
    "radial-tangential": Distortion.RADTAN,
    "plumb_bob": Distortion.RADTAN,
    "rational_polynomial": Distortion.RADTAN,
    "equidistant": Distortion.EQUIDISTANT,
}

#: Share of the image that may have no preimage. Beyond 86 degrees a fisheye has none on the normalised plane,
#: and the corners around its image circle never had; a polynomial that folds there was fitted to little.
_MAX_LOST = {Distortion.NONE: 0.0, Distortion.RADTAN: 0.1, Distortion.EQUIDISTANT: 0.5}
#: Decentring of real lenses is below this; the third coefficient of an equidistant model is often not.
_MAX_DECENTRING = 0.05
#: Pixels that are undone to see whether the distortion can be: so many a side.
_PROBES = 25


def make_lens(
    values: Sequence[float],
    size: Sequence[int],
    model: Distortion,
    coefficients: Sequence[float],
    path: Path,
) -> CameraIntrinsics:
    """A lens of [fx, fy, cx, cy] [px], [width, height] [px] and a distortion.

    Raises:
        CalibrationError: no lens can have these numbers.
    """
    fx, fy, cx, cy = values
    width, height = size
    if not (0 < width <= MAX_PIXELS and 0 < height <= MAX_PIXELS):
        raise CalibrationError(
            f"{path}: resolution is {width} x {height}; expected [width, height] in pixels"
        )
    if not (0.0 < fx < 100 * MAX_PIXELS and 0.0 < fy < 100 * MAX_PIXELS):
        raise CalibrationError(
            f"{path}: focal lengths are {fx:g}, {fy:g}; expected [fx, fy, cx, cy] in pixels"
        )
    if not (-width < cx < 2 * width and -height < cy < 2 * height):
        raise CalibrationError(
            f"{path}: the principal point ({cx:g}, {cy:g}) is far outside the {width} x {height} sensor; "
            "expected intrinsics [fx, fy, cx, cy] in pixels"
        )
    if model is Distortion.NONE and not any(coefficients):
        coefficients = ()
    try:
        distortion.check_coefficients(model, coefficients)
    except GeometryError as error:
        raise CalibrationError(f"{path}: {error}") from error
    lens = tuple(map(float, coefficients))
    return CameraIntrinsics(float(fx), float(fy), float(cx), float(cy), int(width), int(height), model, lens)


def without_zeros(coefficients: Sequence[float]) -> tuple[float, ...]:
    """The shortest radtan coefficients that mean the same: tools fill what they did not fit with zeros.

    `()`, which is a lens without distortion, where all are zero.
    """
    if not any(coefficients):
        return ()
    needed = max(n for n, value in enumerate(coefficients, 1) if value)
    for count in distortion.COEFFICIENT_COUNTS[Distortion.RADTAN]:
        if needed <= count <= len(coefficients):
            return tuple(coefficients[:count])
    return tuple(coefficients)


def read_lens(
    section: dict[str, Any],
    path: Path,
    size: tuple[int, int] | None = None,
    names: tuple[str, str, str, str] = (
        "intrinsics",
        "resolution",
        "distortion_model",
        "distortion_coeffs",
    ),
) -> CameraIntrinsics:
    """A lens from a section that holds it as lists: by default under Kalibr's names.

    Args:
        section: what the file says of one camera.
        path: of the file, for messages.
        size: width and height [px] where the section does not tell them.
        names: keys of [fx, fy, cx, cy], [width, height], the distortion's name and its coefficients.

    Raises:
        CalibrationError: a value is absent, malformed or impossible.
    """
    intrinsics, resolution, model, coefficients = names
    values = numbers(section, intrinsics, 4, path)
    width, height = size or integers(section, resolution, 2, path)
    kind = distortion_named(section.get(model), path, model)
    found = numbers(section, coefficients, None, path) if section.get(coefficients) else ()
    return make_lens(values, (width, height), kind, found, path)


def distortion_named(name: Any, path: Path, key: str) -> Distortion:
    """The distortion model of that name, None being none. Raises CalibrationError where it is unknown."""
    if name is None:
        return Distortion.NONE
    if not isinstance(name, str) or name.lower() not in DISTORTION_NAMES:
        known = ", ".join(Distortion)
        raise CalibrationError(f"{path}: {key} is {shown(name)}; expected one of {known}")
    return DISTORTION_NAMES[name.lower()]


def check_lens(lens: CameraIntrinsics, path: Path) -> tuple[str, ...]:
    """Sentences on what is doubtful about the distortion: it must be undone at every pixel.

    Raises:
        CalibrationError: it folds inside the image: pixels beyond the fold belong to no direction.
    """
    try:
        model = distortion.make_lens(lens.distortion, lens.coefficients)
    except GeometryError as error:
        raise CalibrationError(f"{path}: {error}") from error
    lost = sum(
        distortion.undistort(model, x, y, *distortion.cold_start(model, x, y))[-1] != distortion.SOLVED
        for x in (np.linspace(0.0, lens.width - 1.0, _PROBES) - lens.cx) / lens.fx
        for y in (np.linspace(0.0, lens.height - 1.0, _PROBES) - lens.cy) / lens.fy
    )
    share = lost / _PROBES**2
    if share > _MAX_LOST[lens.distortion]:
        raise CalibrationError(
            f"{path}: the distortion ({lens.distortion}, {', '.join(f'{c:g}' for c in lens.coefficients)}) "
            f"folds inside the image: {share:.0%} of its pixels have no direction. Check the model's name "
            "(coefficients of radtan and equidistant are often exchanged), their order and the resolution"
        )
    notes: tuple[str, ...] = ()
    if lost:
        notes += (f"{path.name}: {share:.1%} of the image have no direction by the distortion: not used",)
    decentring = max(map(abs, lens.coefficients[2:4]), default=0.0)
    if lens.distortion is Distortion.RADTAN and decentring > _MAX_DECENTRING:
        notes += (
            f"{path.name}: a decentring of {decentring:g} is far above that of real lenses; "
            "is the distortion equidistant, not radtan?",
        )
    return notes
