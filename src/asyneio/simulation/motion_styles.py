# SPDX-License-Identifier: Apache-2.0
"""Motion styles by name: amplitudes and frequencies are given, phases are random.

Magnitudes are those of hand-held and small flying cameras. A term is (amplitude, frequency [Hz]). Each
frequency is randomly changed by up to ten per cent, and each phase is random, so different seeds of one style
give different motions.

`translation` and `six_dof` resemble the sequences with these names in a published DAVIS240C data set
(Mueggler et al. 2017): a camera moved by hand in front of a scene with increasing speed, at 1.1 m/s on
average (69 m in a minute of boxes_6dof).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.motion import COORDINATES, AnalyticMotion, Sinusoids
from asyneio.types import FloatArray

_FREQUENCY_SCATTER = 0.1

Terms = tuple[tuple[float, float], ...]


class MotionStyle(StrEnum):
    """Names of the motion styles."""

    GENTLE = "gentle"
    MODERATE = "moderate"
    AGGRESSIVE = "aggressive"
    ROTATION = "rotation"
    STATIC_START = "static_start"
    TRANSLATION = "translation"
    SIX_DOF = "six_dof"


@dataclass(frozen=True)
class _Style:
    terms: tuple[Terms, Terms, Terms, Terms, Terms, Terms]
    hold_s: float = 0.0
    pace: tuple[float, float] = (1.0, 1.0)


#: Pace of a motion with increasing speed.
_SPEEDING_UP = (0.5, 1.7)

_MODERATE = (
    ((0.60, 0.13), (0.08, 0.60)),
    ((0.70, 0.15), (0.08, 0.53)),
    ((0.30, 0.20), (0.05, 0.70)),
    ((0.15, 0.35), (0.05, 0.90)),
    ((0.15, 0.30), (0.05, 1.00)),
    ((0.50, 0.12), (0.15, 0.50)),
)

_STYLES: dict[MotionStyle, _Style] = {
    MotionStyle.GENTLE: _Style(
        (
            ((0.40, 0.10), (0.04, 0.40)),
            ((0.50, 0.08), (0.04, 0.35)),
            ((0.20, 0.12), (0.03, 0.45)),
            ((0.08, 0.25), (0.02, 0.60)),
            ((0.08, 0.20), (0.02, 0.70)),
            ((0.30, 0.08), (0.05, 0.35)),
        )
    ),
    MotionStyle.MODERATE: _Style(_MODERATE),
    MotionStyle.AGGRESSIVE: _Style(
        (
            ((0.55, 0.25), (0.035, 1.50)),
            ((0.60, 0.28), (0.035, 1.40)),
            ((0.30, 0.35), (0.025, 1.60)),
            ((0.33, 0.90), (0.04, 2.50)),
            ((0.24, 0.80), (0.04, 2.30)),
            ((0.40, 0.30), (0.38, 1.00)),
        )
    ),
    MotionStyle.ROTATION: _Style(
        (
            ((0.12, 0.20), (0.02, 0.90)),
            ((0.12, 0.17), (0.02, 1.00)),
            ((0.08, 0.25), (0.02, 1.10)),
            ((0.35, 0.55), (0.05, 1.30)),
            ((0.25, 0.50), (0.05, 1.40)),
            ((1.00, 0.20), (0.20, 0.80)),
        )
    ),
    MotionStyle.STATIC_START: _Style(_MODERATE, hold_s=2.0),
    MotionStyle.TRANSLATION: _Style(
        (
            ((0.47, 0.31), (0.035, 0.95)),
            ((0.55, 0.34), (0.035, 1.05)),
            ((0.30, 0.41), (0.025, 1.15)),
            ((0.05, 0.40), (0.015, 1.10)),
            ((0.05, 0.35), (0.015, 1.20)),
            ((0.08, 0.30), (0.020, 0.90)),
        ),
        pace=_SPEEDING_UP,
    ),
    MotionStyle.SIX_DOF: _Style(
        (
            ((0.47, 0.30), (0.035, 0.90)),
            ((0.55, 0.33), (0.035, 1.00)),
            ((0.30, 0.40), (0.025, 1.10)),
            ((0.30, 0.50), (0.05, 1.20)),
            ((0.20, 0.45), (0.05, 1.30)),
            ((0.35, 0.35), (0.05, 1.10)),
        ),
        pace=_SPEEDING_UP,
    ),
}


def draw_motion(
    style: str, rng: np.random.Generator, C_f_b: FloatArray, position_scale: float = 1.0
) -> AnalyticMotion:
    """Draw a motion of a style, with phases and frequencies from `rng`, centred on the world's origin.

    Args:
        style: a value of `MotionStyle`.
        rng: random generator; the same state gives the same motion.
        C_f_b: (3,3) rotation of the body in the carrier (x forward, y left, z up).
        position_scale: factor on the amplitudes of the position.

    Raises:
        SimulationError: the style is unknown.
    """
    if style not in list(MotionStyle):
        raise SimulationError(f"motion {style!r} is unknown; expected one of {', '.join(MotionStyle)}")
    chosen = _STYLES[MotionStyle(style)]
    table = np.zeros((2, len(COORDINATES), max(len(terms) for terms in chosen.terms)))
    for row, terms in enumerate(chosen.terms):
        table[:, row, : len(terms)] = np.array(terms).T
    amplitude, frequency_hz = table
    amplitude[:3] *= position_scale
    scatter = rng.uniform(1.0 - _FREQUENCY_SCATTER, 1.0 + _FREQUENCY_SCATTER, frequency_hz.shape)
    phase = rng.uniform(0.0, 2.0 * np.pi, amplitude.shape)
    return AnalyticMotion(
        Sinusoids(amplitude, frequency_hz * scatter, phase), C_f_b, hold_s=chosen.hold_s, pace=chosen.pace
    )
