# SPDX-License-Identifier: Apache-2.0
"""Tables of speeds, and comparison with an earlier measurement."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

from asyneio.errors import StudyError
from asyneio.studies.speed import TIMED
from asyneio.studies.speed_run import ESTIMATOR, FRONT_END, PIPELINE, Figures
from asyneio.studies.speed_stages import STAGES
from asyneio.studies.tables import markdown, number

#: Baseline shipped with the package; written by `asyneio bench speed -o`.
_BASELINE = Path(__file__).with_name("speed_baseline.json")
NO_BASELINE = "this copy of the package contains none; make one with -o FILE and pass it with --baseline FILE"
#: Stages with a smaller fraction of the estimator's time in both measurements are not compared.
_LEAST_SHARE = 0.02
#: Properties that must agree for two measurements to have the same workload.
_ALIKE = 0.02


@dataclass(frozen=True)
class Comparison:
    """Ratios of times to those of a baseline, wall-clock and CPU, each relative to the reference work of its
    own run: above one is slower. `why_not`: reason if there are none."""

    ratios: dict[str, float]
    cpu_ratios: dict[str, float]
    why_not: str = ""

    def slower_than(self, gate: float) -> dict[str, float]:
        """The wall-clock ratios above `gate` of stages whose CPU ratio is above it as well.

        Other load increases the wall-clock time only, use of a second core the CPU time only. For the
        pipeline, in which two threads may wait for each other, only the wall-clock time counts.
        """
        return {
            name: ratio
            for name, ratio in self.ratios.items()
            if ratio > gate and (name == PIPELINE or self.cpu_ratios[name] > gate)
        }


def package_baseline() -> Figures | None:
    """The baseline shipped with the package, if there is one."""
    return read_baseline(_BASELINE) if _BASELINE.is_file() else None


def read_baseline(path: Path) -> Figures:
    """Results of an earlier measurement.

    Raises:
        StudyError: the file does not exist, or it is not a baseline.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        kinds, needed = ("relative", "relative_cpu"), (FRONT_END, ESTIMATOR, PIPELINE)
        if all(found[kind][name] > 0.0 for kind in kinds for name in needed) and found["workload"]:
            return dict(found)
    except OSError as error:
        raise StudyError(f"cannot read the baseline {path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, RecursionError):
        pass
    raise StudyError(f"{path} is not a baseline; expected JSON written by `asyneio bench speed -o FILE`")


def compare(found: Figures, baseline: Figures | None) -> Comparison:
    """Ratios to a baseline with the same workload and scheme; small stages are excluded."""
    if baseline is None:
        return Comparison({}, {}, NO_BASELINE)
    here, there = found["workload"], baseline["workload"]
    for name in ("name", "width", "height"):
        if here[name] != there[name]:
            return Comparison({}, {}, f"{name} is {here[name]}, that of the baseline {there[name]}")
    if found["scheme"] != baseline["scheme"]:
        return Comparison(
            {}, {}, f"the scheme is {found['scheme']}, that of the baseline {baseline['scheme']}"
        )
    for name in ("seconds", "events"):
        if abs(here[name] - there[name]) > _ALIKE * there[name]:
            return Comparison({}, {}, f"{name}: {here[name]:g}, in the baseline {there[name]:g}")
    chosen = [
        name
        for name in TIMED
        if all(baseline[kind].get(name) for kind in ("relative", "relative_cpu"))
        and max(_share(found, name), _share(baseline, name)) >= _LEAST_SHARE
    ]
    by_clock, by_cpu = (
        {name: found[kind][name] / baseline[kind][name] for name in chosen}
        for kind in ("relative", "relative_cpu")
    )
    return Comparison(by_clock, by_cpu)


def _share(figures: Figures, name: str) -> float:
    """CPU time as a fraction of that of the estimator."""
    whole = figures["relative_cpu"][ESTIMATOR]
    return float(figures["relative_cpu"].get(name, 0.0) / whole) if whole > 0.0 else 0.0


def speed_markdown(found: Figures, comparison: Comparison) -> str:
    """Tables for reading: workload, stages, latency and other measurements."""
    return "\n".join([_workload_line(found), _stage_table(found, comparison), _figure_table(found)])


def _workload_line(found: Figures) -> str:
    w, machine = found["workload"], found["machine"]
    return (
        f"{w['name']}: {w['seconds']:g} s, {w['events'] / 1e6:.2f} Mev ({w['event_rate'] / 1e6:.2f} Mev/s), "
        f"{w['width']} x {w['height']}, IMU {w['gyroscope_hz']} and {w['accelerometer_hz']} Hz, scheme "
        f"{found['scheme']}; median of {found['repeats']}; {machine['processor']}, {machine['cores']} cores\n"
    )


def _stage_table(found: Figures, comparison: Comparison) -> str:
    recorded_s, events = found["workload"]["seconds"], found["workload"]["events"]
    what = {stage.name: f"- {stage.name}: {stage.what}" for stage in STAGES}
    what |= {
        FRONT_END: f"front end alone ({1e9 * found['seconds'][FRONT_END] / events:.0f} ns per event)",
        ESTIMATOR: "estimator alone, on the same observations",
        PIPELINE: "pipeline: both, in parallel",
    }
    rows = []
    for name in TIMED:
        seconds = found["seconds"][name]
        rows.append(
            [
                what[name],
                str(found["calls"].get(name, "")),
                f"{seconds:.3f}",
                f"{found['cpu_seconds'][name]:.3f}",
                f"{1e3 * seconds / recorded_s:.1f}",
                f"{100.0 * _share(found, name):.1f}" if name in found["calls"] else "",
                *(
                    f"{ratios[name]:.2f}" if name in ratios else ""
                    for ratios in (comparison.ratios, comparison.cpu_ratios)
                ),
            ]
        )
    header = ["stage", "calls", "s", "CPU s", "ms per second of data", "% of the estimator"]
    header += ["times the baseline", "the same, CPU"]
    return markdown(header, rows)


def _figure_table(found: Figures) -> str:
    p, start = found["pipeline"], found["start_up"]
    rows = [
        ["real-time factor of the pipeline", number(p["real_time_factor"])],
        ["CPU time of the pipeline, s", number(p["cpu_s"])],
        [
            "front end beside the estimator, times alone",
            number(p["front_end_s"] / found["seconds"][FRONT_END]),
        ],
        ["peak memory, MB", number(p["peak_memory_mb"])],
    ]
    names = {"queued": "from processing times", "paced": "by the clock, events at their pace"}
    for kind, latency in found["latency_ms"].items():
        figures = "  ".join(number(latency[name]) for name in ("median_ms", "p99_ms", "largest_ms"))
        rows.append([f"latency beyond max_delay_s, {names[kind]}: median, 99 %, largest, ms", figures])
    if "beside" in found:
        b = found["beside"]
        rows += [
            [f"beside {b['processes']} busy processes: times as slow as alone", number(b["slower"])],
            [f"beside {b['processes']} busy processes: real-time factor", number(b["real_time_factor"])],
            [f"beside {b['processes']} busy processes: CPU time, s", number(b["cpu_s"])],
        ]
    rows.append(["start of a process to the first estimate, s", number(start["first_estimate_s"])])
    rows.append(["the same, CPU time, s", number(start["first_estimate_cpu_s"])])
    rows.append(["of it compiling, s", number(start["compile_s"])])
    if "cold_start" in found:
        cold = found["cold_start"]
        rows.append(["without compiled kernels: to the first estimate, s", number(cold["first_estimate_s"])])
        rows.append(["the same, CPU time of all processes, s", number(cold["first_estimate_cpu_s"])])
    rows.append(["reference work, ms", number(1e3 * found["reference_s"])])
    return markdown(["figure", "value"], rows)


def speed_json(found: Figures, comparison: Comparison) -> str:
    """All results as JSON, usable as a baseline; values that are not finite become null."""
    ratios = {
        "times_the_baseline": comparison.ratios,
        "times_the_baseline_cpu": comparison.cpu_ratios,
        "no_ratios_because": comparison.why_not,
    }
    return json.dumps(_plain(found | ratios), indent=2) + "\n"


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
