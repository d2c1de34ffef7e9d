# SPDX-License-Identifier: Apache-2.0
"""Rows of a benchmark: our results by job, and next to published ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from asyneio.studies.records import Record
from asyneio.studies.suites.data_set import DataSet
from asyneio.studies.suites.jobs import BenchTask
from asyneio.studies.suites.measure import EVSLAM
from asyneio.studies.suites.published import Measure
from asyneio.studies.tables import markdown

_OURS = "asyneio"
_ABSENT = "-"
#: Factors of a condition, and their columns.
FACTORS = ("scheme", "settings", "seed")


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
        return tuple(name for name in FACTORS if {task[name] for task in tasks} - {"", 0})


def own_table(report: BenchReport) -> str:
    """One row for each job, and the mean of the successful ones for each condition."""
    keys = _keys(report.suite)
    factors = report.factors
    rows = [
        [
            sequence_of(record),
            *(str(record.task[factor]) or _ABSENT for factor in factors),
            *_cells(record, keys),
        ]
        for record in report.records
    ]
    rows += [
        [task.sequence, *(str(getattr(task, factor)) or _ABSENT for factor in factors), "missing"]
        + [_ABSENT] * (len(keys) - 1)
        for task in report.missing
    ]
    for condition, group in conditions(report).items():
        means = [_text(mean_of(group, key)) if _averaged(key) else "" for key in keys]
        labels = dict(zip(("scheme", "settings"), condition, strict=True))
        rows.append([f"mean of {len(group)}", *(labels.get(factor, "") for factor in factors), *means])
    return markdown(["sequence", *factors, *keys.values()], rows)


def comparison_table(report: BenchReport) -> str:
    """Published results of the measured sequences, and means over these."""
    suite = report.suite
    measured = {sequence_of(record) for record in report.good}
    names = [name for name in compared(suite) if name in measured]
    rows = []
    for condition, group in conditions(report).items():
        for protocol in suite.protocols:
            ours = [
                mean_of([r for r in group if sequence_of(r) == name], figure_key(suite, protocol))
                for name in names
            ]
            label = " ".join(["**" + _OURS + "**", *filter(None, condition)])
            rows.append([label, "E+I", protocol, *_with_mean(ours)])
    for method in suite.published:
        figures = [method.results.get(name, math.nan) for name in names]
        if any(map(math.isfinite, figures)):
            stated = method.alignment or "not stated"
            rows.append([method.method, method.uses, stated, *_with_mean(figures)])
    return markdown(["method", "uses", "protocol", *names, "mean of these"], rows)


def label(record: Record) -> str:
    """A job in messages: the sequence, and its condition if it has one."""
    return label_of(record.task)


def label_of(task: Mapping[str, Any]) -> str:
    """A job in lists: the sequence, and its condition if it has one."""
    seed = f"seed {task['seed']}" if task["seed"] else ""
    condition = ", ".join(filter(None, (str(task["scheme"]), str(task["settings"]), seed)))
    return f"{task['sequence']} ({condition})" if condition else str(task["sequence"])


def _keys(suite: DataSet) -> dict[str, str]:
    """Columns of the table of results: keys of the figures, and titles."""
    short = {Measure.MPE: "MPE %", Measure.ATE: "ATE cm"}[suite.measure]
    errors = {
        figure_key(suite, name): f"{'ATE cm' if name == EVSLAM else short} {name}" for name in suite.protocols
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


def figure_key(suite: DataSet, protocol: str) -> str:
    """Key of the figure of the comparison under a protocol; `evslam` defines an ATE only."""
    return f"{Measure.ATE if protocol == EVSLAM else suite.measure}_{protocol}"


def _averaged(key: str) -> bool:
    return key.startswith(("mpe", "ate", "yaw", "velocity"))


def _cells(record: Record, keys: Mapping[str, str]) -> list[str]:
    if record.failure:
        return ["failed", *[_ABSENT] * (len(keys) - 1)]
    return [_text(record.measured.get(key, math.nan)) for key in keys]


def conditions(report: BenchReport) -> dict[tuple[str, str], list[Record]]:
    """Successful records by scheme and settings, in the order of the jobs."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in report.good:
        condition = str(record.task["scheme"]), str(record.task["settings"])
        groups.setdefault(condition, []).append(record)
    return groups


def compared(suite: DataSet) -> list[str]:
    """Sequences with a published result, in the order of the suite."""
    published = {name for method in suite.published for name in method.results}
    return [name for name in suite.sequences if name in published]


def sequence_of(record: Record) -> str:
    """The sequence of a record."""
    return str(record.task["sequence"])


def mean_of(records: Iterable[Record], key: str) -> float:
    """Mean, or NaN if any value is NaN: a mean over fewer sequences is not comparable."""
    values = [record.measured.get(key, math.nan) for record in records]
    return sum(values) / len(values) if values else math.nan


def _with_mean(figures: Sequence[float]) -> list[str]:
    return [_text(value) for value in (*figures, sum(figures) / len(figures))]


def _text(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else _ABSENT
