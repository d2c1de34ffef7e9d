# SPDX-License-Identifier: Apache-2.0
"""Camera intrinsics from a calibration file, checked: size, focal lengths, invertible distortion."""

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

#: Distortion models by their names in the various tools.
DISTORTION_NAMES = {
    "none": Distortion.NONE,
    "radtan": Distortion.RADTAN,
    "radial-tangential": Distortion.RADTAN,
    "plumb_bob": Distortion.RADTAN,
    "rational_polynomial": Distortion.RADTAN,
    "equidistant": Distortion.EQUIDISTANT,
}

#: Largest share of the image without a viewing direction. A fisheye has none on the normalised plane beyond
#: 86 degrees, nor in the corners outside its image circle, where the polynomial was hardly fitted.
_MAX_LOST = {Distortion.NONE: 0.0, Distortion.RADTAN: 0.1, Distortion.EQUIDISTANT: 0.5}
#: Real lenses have a smaller decentring; the third coefficient of an equidistant model is often larger.
_MAX_DECENTRING = 0.05
#: The distortion is inverted on a grid of this many pixels per side.
_PROBES = 25


def make_intrinsics(
    values: Sequence[float],
    size: Sequence[int],
    model: Distortion,
    coefficients: Sequence[float],
    path: Path,
) -> CameraIntrinsics:
    """Intrinsics from [fx, fy, cx, cy] [px], [width, height] [px] and a distortion.

    Raises:
        CalibrationError: physically impossible values.
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
    focal, centre = (float(fx), float(fy)), (float(cx), float(cy))
    return CameraIntrinsics(*focal, *centre, int(width), int(height), model, tuple(map(float, coefficients)))


def without_zeros(coefficients: Sequence[float]) -> tuple[float, ...]:
    """The shortest equivalent list of radtan coefficients: tools write zeros for those they did not fit.

    `()` if all are zero: no distortion.
    """
    if not any(coefficients):
        return ()
    needed = max(n for n, value in enumerate(coefficients, 1) if value)
    for count in distortion.COEFFICIENT_COUNTS[Distortion.RADTAN]:
        if needed <= count <= len(coefficients):
            return tuple(coefficients[:count])
    return tuple(coefficients)


def read_intrinsics(
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
    """Intrinsics from a section that stores them as lists, by default under Kalibr's names.

    Args:
        section: the part of the file for one camera.
        path: of the file, for messages.
        size: width and height [px] if the section has none.
        names: keys of [fx, fy, cx, cy], [width, height], name of the distortion and its coefficients.

    Raises:
        CalibrationError: a value is missing, malformed or impossible.
    """
    intrinsics, resolution, model, coefficients = names
    values = numbers(section, intrinsics, 4, path)
    width, height = size or integers(section, resolution, 2, path)
    kind = distortion_named(section.get(model), path, model)
    found = numbers(section, coefficients, None, path) if section.get(coefficients) else ()
    return make_intrinsics(values, (width, height), kind, found, path)


def distortion_named(name: Any, path: Path, key: str) -> Distortion:
    """The distortion model with this name, None meaning none. Raises CalibrationError: unknown name."""
    if name is None:
        return Distortion.NONE
    if not isinstance(name, str) or name.lower() not in DISTORTION_NAMES:
        known = ", ".join(Distortion)
        raise CalibrationError(f"{path}: {key} is {shown(name)}; expected one of {known}")
    return DISTORTION_NAMES[name.lower()]


def check_distortion(intrinsics: CameraIntrinsics, path: Path) -> tuple[str, ...]:
    """Check that the distortion can be inverted at every pixel; returns notes on suspect values.

    Raises:
        CalibrationError: it folds inside the image: pixels beyond the fold have no viewing direction.
    """
    try:
        model = distortion.make_lens(intrinsics.distortion, intrinsics.coefficients)
    except GeometryError as error:
        raise CalibrationError(f"{path}: {error}") from error
    lost = sum(
        distortion.undistort(model, x, y, *distortion.cold_start(model, x, y))[-1] != distortion.SOLVED
        for x in (np.linspace(0.0, intrinsics.width - 1.0, _PROBES) - intrinsics.cx) / intrinsics.fx
        for y in (np.linspace(0.0, intrinsics.height - 1.0, _PROBES) - intrinsics.cy) / intrinsics.fy
    )
    share = lost / _PROBES**2
    if share > _MAX_LOST[intrinsics.distortion]:
        raise CalibrationError(
            f"{path}: the distortion ({intrinsics.distortion}, "
            f"{', '.join(f'{c:g}' for c in intrinsics.coefficients)}) folds inside the image: {share:.0%} "
            "of its pixels have no viewing direction. Check the model's name (coefficients of radtan and "
            "equidistant are often exchanged), their order and the resolution"
        )
    notes: tuple[str, ...] = ()
    if lost:
        notes += (
            f"{path.name}: {share:.1%} of the image has no viewing direction under this distortion: not used",
        )
    decentring = max(map(abs, intrinsics.coefficients[2:4]), default=0.0)
    if intrinsics.distortion is Distortion.RADTAN and decentring > _MAX_DECENTRING:
        notes += (
            f"{path.name}: a decentring of {decentring:g} is far above that of real lenses; "
            "is the distortion equidistant, not radtan?",
        )
    return notes
