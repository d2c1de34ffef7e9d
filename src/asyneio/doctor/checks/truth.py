# SPDX-License-Identifier: Apache-2.0
"""Check of the ground truth, if there is any."""

from __future__ import annotations

import numpy as np

from asyneio.doctor.checks.imu_time import streams_of
from asyneio.doctor.inspection import Inspection, note, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.io.recording.trajectory_reader import WRONG_STAMPS
from asyneio.types import NS_PER_S

#: Pauses longer than this [s] are excluded from comparisons; a higher speed than this [m/s] is a jump.
_PAUSE_S, _SPEED = 0.5, 30.0
_COVERED = 0.5
_NORM = 1e-2


def check_truth(inspection: Inspection) -> CheckResult | None:
    """Check rate, pauses, overlap with the recording, quaternion norms and jumps of the ground truth."""
    truth = inspection.truth
    if truth is None or truth.t_ns.size == 0:
        return None
    t_s = (truth.t_ns - truth.t_ns[0]) / NS_PER_S
    steps = np.diff(t_s)
    rate = 1.0 / float(np.median(steps)) if steps.size else 0.0
    norms = float(np.abs(np.linalg.norm(truth.quaternion, axis=1) - 1.0).max())
    travelled = np.linalg.norm(np.diff(truth.position, axis=0), axis=1)
    fastest = float((travelled / np.maximum(steps, 1e-9)).max(initial=0.0))
    share = _covered(inspection)
    pauses = int(np.count_nonzero(steps > max(_PAUSE_S, 3.0 / max(rate, 1e-9))))
    values = {
        "poses": int(truth.t_ns.size),
        "hz": rate,
        "covered_share": share,
        "pauses": pauses,
        "fastest_m_s": fastest,
        "path_m": float(travelled.sum()),
    }
    measured = f"{truth.t_ns.size} poses at {rate:.4g} Hz over {t_s[-1]:.4g} s, {travelled.sum():.3g} m"
    measured += f", covers {share:.0%} of the recording" if share is not None else ""
    if share is not None and share < _COVERED:
        fix = "timestamps of another clock or unit? Only the part with ground truth is evaluated"
        return warning("ground truth", measured, "poses over the whole recording", fix, **values)
    if norms > _NORM or fastest > _SPEED:
        measured += f"; quaternion norms off by {norms:.2g}, up to {fastest:.3g} m/s"
        fix = "check the columns (quaternions x y z w, positions in metres); motion capture may have jumped"
        return warning("ground truth", measured, f"unit quaternions, below {_SPEED:g} m/s", fix, **values)
    wrong = next((text for text in inspection.notes if WRONG_STAMPS in text), "")
    if wrong:
        fix = "a run drops them; check how the time stamps were written"
        return warning("ground truth", f"{measured}; {wrong}", "time stamps of one clock", fix, **values)
    if pauses:
        return note(
            "ground truth", f"{measured}; {pauses} pause(s)", "", "pauses are not evaluated", **values
        )
    return ok("ground truth", measured, **values)


def _covered(inspection: Inspection) -> float | None:
    """Fraction of the recording between the first and the last pose."""
    span = inspection.span_ns()
    shift = inspection.calibration.timeshift_ns if inspection.calibration else 0
    if span is None:
        times = [t for _, t, _ in streams_of(inspection)]
        if not times:
            return None
        span, shift = (min(int(t.min()) for t in times), max(int(t.max()) for t in times)), 0
    assert inspection.truth is not None
    begin, end = int(inspection.truth.t_ns[0]), int(inspection.truth.t_ns[-1])
    shared = min(span[1] + shift, end) - max(span[0] + shift, begin)
    return max(shared, 0) / max(span[1] - span[0], 1)
