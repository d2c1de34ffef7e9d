# SPDX-License-Identifier: Apache-2.0
"""Summaries and evaluations as table rows: a label, and a value with its unit."""

from __future__ import annotations

import math
from typing import Any

from asyneio.evaluation import Evaluation
from asyneio.pipeline.summary import Summary
from asyneio.types import Health
from asyneio.viz.data import Rows


def run_rows(summary: Summary, scores: dict[int, Evaluation]) -> Rows:
    """Rows for a run, followed by those of the evaluation of its segments."""
    rows = [
        ("health", str(summary.health)),
        ("recording", f"{summary.duration_s:.2f} s"),
        ("processing", f"{summary.processing_s:.2f} s, {summary.real_time_factor:.1f} times real time"),
    ]
    if summary.compile_s > 0.0:
        rows.append(("compilation (first run only)", f"{summary.compile_s:.1f} s"))
    if summary.events:
        rate = summary.events / max(summary.frontend_s, 1e-9) / 1e6
        rows.append(("events", f"{summary.events / 1e6:.2f} million, tracked at {rate:.2f} Mev/s"))
    rows += [
        ("first estimate after", _seconds(summary.first_estimate_s)),
        ("knots", f"{summary.knots}"),
        ("feature tracks", f"{summary.features}, mean life {summary.mean_track_life_s:.2f} s"),
        ("landmarks in the window", f"{summary.mean_landmarks:.0f} on average"),
        ("observations", f"{summary.observations}, {summary.rejected} rejections"),
    ]
    camera = summary.camera
    if camera is not None and camera.time_offset_sigma_s > 0.0:
        offset = f"{1e3 * camera.time_offset_s:+.2f} ms, sigma {1e3 * camera.time_offset_sigma_s:.2f} ms"
        rows.append(("time offset of the camera", f"{offset}, added to the calibrated shift"))
    if summary.nis is not None:
        ratios = (
            f"{summary.nis.visual:.2f} visual, {summary.nis.inertial:.2f} inertial (1: as the noise predicts)"
        )
        rows.append(("squared residuals (NIS)", ratios))
    degraded_s = summary.health_s[Health.DEGRADED]
    if degraded_s > 0.0:
        rows.append(("degraded", f"{degraded_s:.1f} s in total"))
    if len(summary.segments) > 1:
        rows += [
            (
                f"segment {segment.segment}",
                f"{segment.start_s:.2f} to {segment.end_s:.2f} s, {segment.knots} knots: {segment.ended}",
            )
            for segment in summary.segments
        ]
    return (*rows, *evaluation_rows(scores))


def evaluation_rows(scores: dict[int, Evaluation]) -> Rows:
    """Rows for the evaluation of each segment, by its number."""
    if len(scores) == 1:
        return _segment_rows(next(iter(scores.values())))
    return tuple(
        row
        for segment, score in scores.items()
        for row in ((f"segment {segment}", "aligned separately"), *_segment_rows(score))
    )


def _segment_rows(score: Evaluation) -> Rows:
    position, orientation = score.position_m, score.orientation_deg
    rows = [
        ("aligned by", score.protocol.name),
        ("compared", f"{score.associated} poses over {score.duration_s:.2f} s, {score.path_length_m:.2f} m"),
        ("position error, RMSE (ATE)", f"{100.0 * position.rmse:.3f} cm"),
        ("position error, max", f"{100.0 * position.max:.3f} cm"),
        ("orientation error, RMSE", f"{orientation.rmse:.3f} deg"),
        ("yaw error, RMSE", f"{score.yaw_deg.rmse:.3f} deg"),
        ("error per path length (MPE)", _unless_nan(score.mpe_percent, "{:.3f} %")),
        ("yaw error per path length", _unless_nan(score.yaw_error_deg_per_m, "{:.4f} deg/m")),
        ("scale error", _unless_nan(score.scale_error_percent, "{:+.2f} %")),
    ]
    if score.unassociated:
        rows.insert(2, ("poses without ground truth", f"{score.unassociated}"))
    for relative in score.relative:
        name = f"relative error over {relative.delta:g} {relative.unit}"
        rows.append(
            (name, f"{100.0 * relative.translation_m.rmse:.2f} cm, {relative.rotation_deg.rmse:.2f} deg RMSE")
        )
    return tuple(rows)


def track_rows(summary: dict[str, Any]) -> Rows:
    """Table rows for a run of the front end: a label, and a value with its unit."""
    alive = summary["alive"]
    rows = [
        ("tracker", f"{summary['tracker']}, {'with' if summary['gyroscope_used'] else 'without'} gyroscope"),
        (
            "recording",
            f"{summary['duration_s']:.2f} s, {summary['events']} events, "
            f"{summary['event_rate_mev_s']:.2f} Mev/s",
        ),
        (
            "processing",
            f"{summary['processing_s']:.2f} s, {summary['speed_mev_s']:.2f} Mev/s, "
            f"{summary['ns_per_event']:.0f} ns per event, {summary['real_time_factor']:.1f} times real time",
        ),
        (
            "features alive",
            f"{alive['median']:.0f} (median), {alive['tenth_percentile']:.0f} (10th percentile)",
        ),
        ("feature tracks", f"{summary['tracks']}, {summary['observations']} observations"),
    ]
    return (*rows, *_track_end_rows(summary))


def _track_end_rows(summary: dict[str, Any]) -> Rows:
    life, counts = summary["life_s"], summary["statistics"]
    rows: list[tuple[str, str]] = []
    if summary["tracks"]:
        rows.append(
            (
                "life",
                f"{life['median']:.2f} s (median), {life['quartile']:.2f}-{life['upper_quartile']:.2f} s "
                f"(quartiles), {life['longest']:.2f} s (longest)",
            )
        )
    rows.append(
        (
            "ended",
            f"{counts['ended_untrusted']} unreliable, {counts['ended_border']} at the border, "
            f"{counts['ended_silent']} without events",
        )
    )
    if counts["hot_pixels"]:
        rows.append(
            ("defective pixels", f"{counts['hot_pixels']}, {counts['hot_events']} of their events dropped")
        )
    left_out = counts["shed_events"] + counts["shed_feature_events"]
    if left_out:
        rows.append(("dropped (frontend.max_load)", f"{left_out} events, {counts['shed_features']} features"))
    if summary["compile_s"] > 1.0:
        rows.append(("compilation (first run only)", f"{summary['compile_s']:.1f} s"))
    return tuple(rows)


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if math.isfinite(value) else "never"


def _unless_nan(value: float, layout: str) -> str:
    return layout.format(value) if math.isfinite(value) else "undetermined"
