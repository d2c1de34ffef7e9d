# SPDX-License-Identifier: Apache-2.0
"""Tables of a benchmark: our results and published ones, each with its protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from asyneio.studies.records import Record
from asyneio.studies.suites.data_set import TruthFrame
from asyneio.studies.suites.published import Measure
from asyneio.studies.suites.report_tables import (
    FACTORS,
    BenchReport,
    compared,
    comparison_table,
    conditions,
    figure_key,
    label_of,
    mean_of,
    own_table,
)

_PROTOCOL_WORDS = {
    "posyaw": "position and yaw over the whole run",
    "se3": "SE(3) over the whole run",
    "uslam": "SE(3) on seconds 3-8",
    "hku": "SE(3) on seconds 0-5",
    "evslam": "SE(3) at 10 Hz, and AUC of the velocity error",
}
_MEASURE_WORDS = {
    Measure.MPE: "MPE: mean position error over the length of the true path",
    Measure.ATE: "ATE: root mean square of the position error",
}
_FRAME_WORDS = {
    TruthFrame.BODY: "",
    TruthFrame.CAMERA: " The truth is the camera's pose; the estimate was moved into the camera.",
    TruthFrame.MARKERS: " The truth is the pose of the markers; the estimate was moved to them.",
}


def report_markdown(report: BenchReport) -> str:
    """All tables, what failed, is missing or ran again, and remarks."""
    suite = report.suite
    words = "; ".join(f"{name}: {_PROTOCOL_WORDS[name]}" for name in suite.protocols)
    parts = [
        f"# {suite.title}\n",
        f"`{report.command}`\n",
        own_table(report),
        f"{_MEASURE_WORDS[suite.measure]}. Protocols: {words}.{_FRAME_WORDS[suite.frame]}\n",
    ]
    if suite.remark:
        parts.append(suite.remark + "\n")
    parts += _lists(report)
    if any(record.task["sequence"] in compared(suite) for record in report.good):
        title = f"## Comparison with published results, {suite.measure.heading}\n"
        parts += [title, comparison_table(report), _caution(report)]
    if suite.sources:
        parts.append("Sources of the preset: " + "; ".join(suite.sources) + ".\n")
    return "\n".join(parts)


def report_json(report: BenchReport) -> dict[str, Any]:
    """All results as plain values, NaN as None."""
    keys = [figure_key(report.suite, protocol) for protocol in report.suite.protocols]
    return {
        "suite": report.suite.name,
        "command": report.command,
        "results": [_plain_record(record) for record in report.records],
        "missing": [_factors_of(asdict(task)) for task in report.missing],
        "means": [
            {"scheme": scheme, "settings": settings, "jobs": len(group)}
            | _plain({key: mean_of(group, key) for key in keys})
            for (scheme, settings), group in conditions(report).items()
        ],
        "published": [
            {
                "method": method.method,
                "uses": method.uses,
                "protocol": method.alignment or None,
                "measure": str(report.suite.measure),
                "source": method.source,
                "results": dict(method.results),
            }
            for method in report.suite.published
        ],
    }


def _lists(report: BenchReport) -> list[str]:
    """What failed, is missing, or ran again."""
    parts = []
    if report.failed:
        lines = "".join(f"- {label_of(r.task)}: {r.failure}\n" for r in report.failed)
        parts.append(f"Failed:\n\n{lines}")
    if report.missing:
        lines = "".join(f"- {label_of(asdict(task))}\n" for task in report.missing)
        parts.append(f"Missing, because the run stopped; the same command continues it:\n\n{lines}")
    if report.retried:
        lines = "".join(f"- {label_of(r.task)}: {r.restarts} worker(s) died\n" for r in report.retried)
        parts.append(f"Run again, because a worker died:\n\n{lines}")
    return parts


def _caution(report: BenchReport) -> str:
    short = sorted({float(record.task["seconds"]) for record in report.records if record.task["seconds"]})
    partial = (
        f" Ours are over the first {short[0]:g} s of each sequence, theirs over all of it: not comparable."
        if short
        else ""
    )
    sources = dict.fromkeys(method.source for method in report.suite.published if method.source)
    return (
        f"Published results are from: {'; '.join(sources)}. Only rows with the same protocol are comparable."
        f"{partial}\n"
    )


def _factors_of(task: Mapping[str, Any]) -> dict[str, Any]:
    return {name: task[name] for name in ("sequence", *FACTORS)}


def _plain_record(record: Record) -> dict[str, Any]:
    figures = {"failure": record.failure} if record.failure else _plain(record.measured)
    return {**_factors_of(record.task), "restarts": record.restarts, **figures}


def _plain(measured: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in measured.items()}
