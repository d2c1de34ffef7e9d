# SPDX-License-Identifier: Apache-2.0
"""Tables of the benchmark on the UZH data set: our results and published ones, each with its protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from asyneio.studies.published import COMPARED, PUBLISHED
from asyneio.studies.records import Record
from asyneio.studies.tables import markdown
from asyneio.studies.uzh import PROTOCOLS

_OURS = "asyneio"
_ABSENT = "-"
_PROTOCOL_WORDS = {
    "posyaw": "position and yaw over the whole run",
    "uslam": "SE(3) on seconds 3-8",
    "hku": "SE(3) on seconds 0-5",
}


def report_markdown(records: Sequence[Record], command: str) -> str:
    """Both tables, failures and remarks."""
    good = _good(records)
    parts = [
        "# UZH event camera data set, DAVIS240C\n",
        f"`{command}`\n",
        own_table(records),
        "MPE: mean position error over the length of the true path. Protocols: "
        + "; ".join(f"{name}: {_PROTOCOL_WORDS[name]}" for name in PROTOCOLS)
        + ". The truth is the camera's pose; the estimate was moved into the camera.\n",
    ]
    failed = [record for record in records if record.failure]
    if failed:
        parts.append("Failed:\n\n" + "".join(f"- {_name(r)}: {r.failure}\n" for r in failed))
    if any(name in COMPARED for name in good):
        parts += [
            "## Comparison with published results, MPE [%]\n",
            comparison_table(records),
            _caution(records),
        ]
    return "\n".join(parts)


def own_table(records: Sequence[Record]) -> str:
    """One row per sequence, and the mean of the successful ones."""
    header = [
        "sequence",
        "s",
        "path m",
        *(f"MPE % {name}" for name in PROTOCOLS),
        "yaw deg/m posyaw",
        "scale %",
        "times real time",
    ]
    keys = [
        "duration_s",
        "path_m",
        *(f"mpe_percent_{name}" for name in PROTOCOLS),
        "yaw_deg_per_m_posyaw",
        "scale_error_percent",
        "real_time_factor",
    ]
    rows = [
        [_name(record), *(_text(record.measured.get(key, math.nan)) for key in keys)]
        if not record.failure
        else [_name(record), "failed", *[_ABSENT] * (len(keys) - 1)]
        for record in records
    ]
    good = _good(records)
    if good:
        averaged = {key for key in keys if key.startswith(("mpe", "yaw"))}
        means = [_text(_mean(good, key)) if key in averaged else "" for key in keys]
        rows.append([f"mean of {len(good)}", *means])
    return markdown(header, rows)


def comparison_table(records: Sequence[Record]) -> str:
    """Published results of the measured sequences, and means over these."""
    good = _good(records)
    names = [name for name in COMPARED if name in good]
    rows = [
        [
            f"**{_OURS}**",
            "E+I",
            protocol,
            *(_text(good[name][f"mpe_percent_{protocol}"]) for name in names),
            _text(_mean({name: good[name] for name in names}, f"mpe_percent_{protocol}")),
        ]
        for protocol in PROTOCOLS
    ]
    for method in PUBLISHED:
        figures = [method.of(name) for name in names]
        stated = method.alignment or "not stated"
        texts = [_text(value) for value in (*figures, sum(figures) / len(figures))]
        rows.append([method.method, method.uses, stated, *texts])
    return markdown(["method", "uses", "protocol", *names, "mean of these"], rows)


def report_json(records: Sequence[Record], command: str) -> dict[str, Any]:
    """All results as plain values, NaN as None."""
    good = _good(records)
    return {
        "command": command,
        "sequences": {
            _name(record): {"failure": record.failure} if record.failure else _plain(record.measured)
            for record in records
        },
        "means": _plain({f"mpe_percent_{name}": _mean(good, f"mpe_percent_{name}") for name in PROTOCOLS}),
        "published_mpe_percent": {
            method.method: {
                "uses": method.uses,
                "protocol": method.alignment or None,
                **dict(zip(COMPARED, method.mpe_percent, strict=True)),
            }
            for method in PUBLISHED
        },
    }


def _caution(records: Sequence[Record]) -> str:
    short = sorted({float(record.task["seconds"]) for record in records if record.task["seconds"]})
    partial = (
        f" Ours are over the first {short[0]:g} s of each sequence, theirs over all of it: not comparable."
        if short
        else ""
    )
    return (
        "Published results are the authors' own, with the given protocol; only rows with the same "
        f"protocol are comparable.{partial}\n"
    )


def _good(records: Sequence[Record]) -> dict[str, dict[str, float]]:
    return {_name(record): record.measured for record in records if not record.failure}


def _name(record: Record) -> str:
    return str(record.task["sequence"])


def _mean(good: Mapping[str, Mapping[str, float]], key: str) -> float:
    """Mean, or NaN if any value is NaN: a mean over fewer sequences is not comparable."""
    values = [measured[key] for measured in good.values()]
    return sum(values) / len(values) if values else math.nan


def _text(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else _ABSENT


def _plain(measured: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in measured.items()}
