# SPDX-License-Identifier: Apache-2.0
"""Tables of a benchmark: our results and published ones, each with its protocol."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from asyneio.studies.records import Record
from asyneio.studies.suites.data_set import DataSet, TruthFrame
from asyneio.studies.suites.jobs import BenchTask
from asyneio.studies.suites.measure import EVSLAM
from asyneio.studies.suites.published import Measure
from asyneio.studies.tables import markdown

_OURS = "asyneio"
_ABSENT = "-"
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
#: Factors of a condition, and their columns.
_FACTORS = {"scheme": "scheme", "settings": "settings", "seed": "seed"}


@dataclass(frozen=True)
class BenchReport:
    """Records of a suite, tasks without a record (because the run stopped), and the command line."""

    suite: DataSet
    records: tuple[Record, ...]
    missing: tuple[BenchTask, ...]
    command: str

    @property
    def good(self) -> list[Record]:
        """Records of successful jobs."""
        return [record for record in self.records if not record.failure]

    @property
    def failed(self) -> list[Record]:
        """Records of failed jobs."""
        return [record for record in self.records if record.failure]

    @property
    def retried(self) -> list[Record]:
        """Records of jobs that ran again, because their worker died."""
        return [record for record in self.records if record.restarts]

    @property
    def factors(self) -> tuple[str, ...]:
        """Factors that differ between jobs, or from the configuration."""
        tasks = [*(record.task for record in self.records), *(asdict(task) for task in self.missing)]
        return tuple(name for name in _FACTORS if {task[name] for task in tasks} - {"", 0})


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
    if any(record.task["sequence"] in _compared(suite) for record in report.good):
        title = f"## Comparison with published results, {suite.measure.heading}\n"
        parts += [title, comparison_table(report), _caution(report)]
    if suite.sources:
        parts.append("Sources of the preset: " + "; ".join(suite.sources) + ".\n")
    return "\n".join(parts)


def own_table(report: BenchReport) -> str:
    """One row for each job, and the mean of the successful ones for each condition."""
    keys = _keys(report.suite)
    factors = report.factors
    rows = [
        [_name(record), *(str(record.task[factor]) or _ABSENT for factor in factors), *_cells(record, keys)]
        for record in report.records
    ]
    rows += [
        [task.sequence, *(str(getattr(task, factor)) or _ABSENT for factor in factors), "missing"]
        + [_ABSENT] * (len(keys) - 1)
        for task in report.missing
    ]
    for condition, group in _conditions(report).items():
        means = [_text(_mean(group, key)) if _averaged(key) else "" for key in keys]
        labels = dict(zip(("scheme", "settings"), condition, strict=True))
        rows.append([f"mean of {len(group)}", *(labels.get(factor, "") for factor in factors), *means])
    return markdown(["sequence", *(_FACTORS[factor] for factor in factors), *keys.values()], rows)


def comparison_table(report: BenchReport) -> str:
    """Published results of the measured sequences, and means over these."""
    suite = report.suite
    measured = {_name(record) for record in report.good}
    names = [name for name in _compared(suite) if name in measured]
    rows = []
    for condition, group in _conditions(report).items():
        for protocol in suite.protocols:
            ours = [_mean([r for r in group if _name(r) == name], _key(suite, protocol)) for name in names]
            label = " ".join(["**" + _OURS + "**", *filter(None, condition)])
            rows.append([label, "E+I", protocol, *_with_mean(ours)])
    for method in suite.published:
        figures = [method.results.get(name, math.nan) for name in names]
        if any(map(math.isfinite, figures)):
            stated = method.alignment or "not stated"
            rows.append([method.method, method.uses, stated, *_with_mean(figures)])
    return markdown(["method", "uses", "protocol", *names, "mean of these"], rows)


def report_json(report: BenchReport) -> dict[str, Any]:
    """All results as plain values, NaN as None."""
    keys = [_key(report.suite, protocol) for protocol in report.suite.protocols]
    return {
        "suite": report.suite.name,
        "command": report.command,
        "results": [_plain_record(record) for record in report.records],
        "missing": [_factors_of(asdict(task)) for task in report.missing],
        "means": [
            {"scheme": scheme, "settings": settings, "jobs": len(group)}
            | _plain({key: _mean(group, key) for key in keys})
            for (scheme, settings), group in _conditions(report).items()
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


def _keys(suite: DataSet) -> dict[str, str]:
    """Columns of the table of results: keys of the figures, and titles."""
    short = {Measure.MPE: "MPE %", Measure.ATE: "ATE cm"}[suite.measure]
    errors = {
        _key(suite, name): f"{'ATE cm' if name == EVSLAM else short} {name}" for name in suite.protocols
    }
    if EVSLAM in suite.protocols:
        errors["velocity_auc_evslam"] = "velocity AUC"
    return {
        "duration_s": "s",
        "path_m": "path m",
        **errors,
        "yaw_deg_per_m_posyaw": "yaw deg/m posyaw",
        "scale_error_percent": "scale %",
        "real_time_factor": "times real time",
    }


def _key(suite: DataSet, protocol: str) -> str:
    """Key of the figure of the comparison under a protocol; `evslam` defines an ATE only."""
    return f"{Measure.ATE if protocol == EVSLAM else suite.measure}_{protocol}"


def _averaged(key: str) -> bool:
    return key.startswith(("mpe", "ate", "yaw", "velocity"))


def _cells(record: Record, keys: Mapping[str, str]) -> list[str]:
    if record.failure:
        return ["failed", *[_ABSENT] * (len(keys) - 1)]
    return [_text(record.measured.get(key, math.nan)) for key in keys]


def _lists(report: BenchReport) -> list[str]:
    """What failed, is missing, or ran again."""
    parts = []
    if report.failed:
        lines = "".join(f"- {_label(r.task)}: {r.failure}\n" for r in report.failed)
        parts.append(f"Failed:\n\n{lines}")
    if report.missing:
        lines = "".join(f"- {_label(asdict(task))}\n" for task in report.missing)
        parts.append(f"Missing, because the run stopped; the same command continues it:\n\n{lines}")
    if report.retried:
        lines = "".join(f"- {_label(r.task)}: {r.restarts} worker(s) died\n" for r in report.retried)
        parts.append(f"Run again, because a worker died:\n\n{lines}")
    return parts


def label(record: Record) -> str:
    """A job in messages: the sequence, and its condition if it has one."""
    return _label(record.task)


def _label(task: Mapping[str, Any]) -> str:
    seed = f"seed {task['seed']}" if task["seed"] else ""
    condition = ", ".join(filter(None, (str(task["scheme"]), str(task["settings"]), seed)))
    return f"{task['sequence']} ({condition})" if condition else str(task["sequence"])


def _conditions(report: BenchReport) -> dict[tuple[str, str], list[Record]]:
    """Successful records by scheme and settings, in the order of the jobs."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in report.good:
        condition = str(record.task["scheme"]), str(record.task["settings"])
        groups.setdefault(condition, []).append(record)
    return groups


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


def _compared(suite: DataSet) -> list[str]:
    """Sequences with a published result, in the order of the suite."""
    published = {name for method in suite.published for name in method.results}
    return [name for name in suite.sequences if name in published]


def _name(record: Record) -> str:
    return str(record.task["sequence"])


def _mean(records: Iterable[Record], key: str) -> float:
    """Mean, or NaN if any value is NaN: a mean over fewer sequences is not comparable."""
    values = [record.measured.get(key, math.nan) for record in records]
    return sum(values) / len(values) if values else math.nan


def _with_mean(figures: Sequence[float]) -> list[str]:
    return [_text(value) for value in (*figures, sum(figures) / len(figures))]


def _text(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else _ABSENT


def _factors_of(task: Mapping[str, Any]) -> dict[str, Any]:
    return {name: task[name] for name in ("sequence", *_FACTORS)}


def _plain_record(record: Record) -> dict[str, Any]:
    figures = {"failure": record.failure} if record.failure else _plain(record.measured)
    return {**_factors_of(record.task), "restarts": record.restarts, **figures}


def _plain(measured: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in measured.items()}
