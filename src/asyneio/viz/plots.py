"""The plots of a report: plain arrays in, a figure out; to be called inside `style.plotting()`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asyneio.types import FloatArray
from asyneio.viz.data import Comparison, Features, HealthTimeline, Series, Timing
from asyneio.viz.style import ACCENT, AXES_COLORS, ESTIMATE, HEALTH_COLORS, TRUTH, WIDTH, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: More points than this no screen can show and only make the page heavy.
MAX_POINTS = 1500

#: Inches of a path panel between its axis labels.
_PATH_WIDTH = 4.2


def plot_path(position: FloatArray, comparison: Comparison | None) -> Figure:
    """The path from above and from the side, over the truth where there is one; metres, equal scales."""
    from matplotlib.figure import Figure

    shown = position if comparison is None else comparison.position_estimate
    everything = shown if comparison is None else np.vstack([shown, comparison.position_truth])
    centre, spans = _frame(everything)
    # The sheet takes the shape of the path, so that equal scales neither crop it nor leave it lost in white.
    height = _PATH_WIDTH * float(spans[1] + spans[2]) / float(spans[0]) + 1.1
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    top, side = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": spans[1:]})
    for axes, vertical, title in ((top, 1, "from above"), (side, 2, "from the side")):
        if comparison is not None:
            _path(axes, comparison.position_truth, vertical, TRUTH, "truth", 2.6, 0.45)
        _path(axes, shown, vertical, ESTIMATE, "estimate", 1.1, 1.0)
        axes.plot(*shown[0, [0, vertical]], "o", color=ACCENT, markersize=5, label="start", zorder=5)
        limits = centre[vertical] + np.array([-0.5, 0.5]) * spans[vertical]
        axes.set(aspect="equal", title=title, ylabel=f"{'xyz'[vertical]} [m]", ylim=limits)
    side.set(xlabel="x [m]", xlim=centre[0] + np.array([-0.5, 0.5]) * spans[0])
    figure.legend(*top.get_legend_handles_labels(), ncols=3, loc="outside upper right")
    return figure


def plot_errors(series: Series, unit: str, names: tuple[str, str, str]) -> Figure:
    """Error of each axis over time inside its three-sigma band."""
    figure, panels = new_figure(3, 4.2)
    _errors(panels, series, unit, names)
    panels[0].set_title("error and 3 sigma", fontweight="normal", fontsize=9)
    return figure


def plot_vector(series: Series, unit: str, names: tuple[str, str, str]) -> Figure:
    """Value of each axis over time with its three-sigma band, and the truth where there is one."""
    figure, panels = new_figure(3, 4.2)
    for axis, axes in enumerate(panels):
        t_s, value, sigma = _thin(series.t_s, series.value[:, axis], series.sigma[:, axis])
        if series.truth is not None:
            axes.plot(*_thin(series.t_s, series.truth[:, axis]), color=TRUTH, linewidth=2.4, alpha=0.45)
        _band(axes, t_s, value, sigma, AXES_COLORS[axis])
        axes.plot(t_s, value, color=AXES_COLORS[axis])
        _limit_to_settled(axes, value, sigma)
        axes.set_ylabel(f"{names[axis]} [{unit}]")
    known = "value, 3 sigma and truth (grey)" if series.truth is not None else "value and 3 sigma"
    panels[0].set_title(known, fontweight="normal", fontsize=9)
    panels[-1].set_xlabel("time [s]")
    return figure


def plot_overview(comparison: Comparison) -> Figure:
    """One picture of a run against the truth: the path from above, and the position error with its bounds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    left, right = np.ravel(np.asarray(figure.subfigures(1, 2, width_ratios=(0.85, 1.15))))
    path = left.subplots()
    _path(path, comparison.position_truth, 1, TRUTH, "truth", 3.0, 0.45)
    _path(path, comparison.position_estimate, 1, ESTIMATE, "estimate", 1.2, 1.0)
    path.plot(*comparison.position_estimate[0, :2], "o", color=ACCENT, markersize=5, label="start", zorder=5)
    path.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    path.set_adjustable("datalim")
    left.legend(*path.get_legend_handles_labels(), ncols=3, loc="outside upper center")
    panels = list(right.subplots(3, 1, sharex=True))
    error = comparison.position_error
    _errors(panels, Series(error.t_s, 100.0 * error.value, 100.0 * error.sigma), "cm", ("x", "y", "z"))
    panels[0].set_title("position error and 3 sigma", fontweight="normal")
    return figure


def plot_features(features: Features) -> Figure:
    """How many tracks are alive, and how old they are."""
    figure, (count, age) = new_figure(2, 3.2)
    t_s, alive = _thin(features.t_s, features.alive)
    count.fill_between(t_s, alive, step="mid", color=ESTIMATE, alpha=0.25, linewidth=0.0)
    count.plot(t_s, alive, color=ESTIMATE, drawstyle="steps-mid")
    count.set(ylabel="tracks alive", ylim=(0.0, None))
    t_s, low, middle, high = _thin(features.t_s, *features.age_s.T)
    age.fill_between(t_s, low, high, color=AXES_COLORS[1], alpha=0.2, linewidth=0.0, label="quartiles")
    age.plot(t_s, middle, color=AXES_COLORS[1], label="median")
    # Room above for the legend.
    age.set(ylabel="age [s]", xlabel="time [s]", ylim=(0.0, max(1.35 * float(np.nanmax(high)), 1e-3)))
    age.legend(ncols=2, loc="upper right")
    return figure


def plot_health(health: HealthTimeline) -> Figure:
    """State over time, one row for each; borders of segments as dashed lines."""
    figure, (axes,) = new_figure(1, 1.9)
    step_s = float(np.median(np.diff(health.t_s))) if health.t_s.size > 1 else 0.1
    heads = np.flatnonzero(np.r_[True, np.diff(health.state) != 0])
    ends = np.r_[heads[1:], health.t_s.size] - 1
    for head, end in zip(heads, ends, strict=True):
        row, begin = int(health.state[head]), float(health.t_s[head]) - step_s
        span = (begin, float(health.t_s[end]) - begin)
        axes.broken_barh([span], (row - 0.35, 0.7), facecolors=HEALTH_COLORS[row % len(HEALTH_COLORS)])
    for border in np.flatnonzero(np.diff(health.segment) != 0):
        axes.axvline(float(health.t_s[border]), color=TRUTH, linestyle="--", linewidth=1.0)
    axes.set_yticks(range(len(health.names)), health.names)
    axes.set(xlabel="time [s]", ylim=(-0.6, len(health.names) - 0.4))
    return figure


def plot_timing(timing: Timing) -> Figure:
    """Processing time of each step against the time it may take."""
    figure, (axes,) = new_figure(1, 2.4)
    step_ms, budget_ms = 1e3 * timing.step_s, 1e3 * timing.interval_s
    axes.plot(timing.t_s, step_ms, ".", color=ESTIMATE, markersize=2.5, label="one step", rasterized=True)
    axes.axhline(budget_ms, color=ACCENT, linestyle="--", label=f"real time ({budget_ms:.0f} ms)")
    axes.set(xlabel="time [s]", ylabel="processing [ms]", yscale="log")
    low, high = (float(np.percentile(step_ms, share)) for share in (1.0, 100.0))
    axes.set_ylim(max(0.3 * low, 1e-3), 2.5 * max(high, budget_ms))
    axes.legend(ncols=2, loc="upper right")
    return figure


def _frame(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle (3,) and span (3,) of what the path's panels show, with a margin; no panel degenerates."""
    low, high = np.nanmin(position, axis=0), np.nanmax(position, axis=0)
    spans = np.maximum(1.12 * (high - low), 1e-3)
    spans[0] = max(spans[0], 0.8 * max(spans[1], spans[2]))
    spans[1:] = np.maximum(spans[1:], 0.3 * spans[0])
    return (low + high) / 2.0, spans


def _errors(panels: list[Axes], series: Series, unit: str, names: tuple[str, str, str]) -> None:
    for axis, axes in enumerate(panels):
        t_s, error, sigma = _thin(series.t_s, series.value[:, axis], series.sigma[:, axis])
        _band(axes, t_s, np.zeros_like(t_s), sigma, AXES_COLORS[axis])
        axes.plot(t_s, error, color=AXES_COLORS[axis])
        axes.axhline(0.0, color="#999999", linewidth=0.6)
        axes.set_ylabel(f"{names[axis]} [{unit}]")
    panels[-1].set_xlabel("time [s]")


def _path(
    axes: Axes, position: FloatArray, vertical: int, color: str, label: str, width: float, alpha: float
) -> None:
    x, y = _thin(position[:, 0], position[:, vertical])
    axes.plot(x, y, color=color, label=label, linewidth=width, alpha=alpha)


def _band(axes: Axes, t_s: FloatArray, middle: FloatArray, sigma: FloatArray, color: str) -> None:
    axes.fill_between(t_s, middle - 3.0 * sigma, middle + 3.0 * sigma, color=color, alpha=0.15, linewidth=0.0)


def _limit_to_settled(axes: Axes, value: FloatArray, sigma: FloatArray) -> None:
    """Keep a wide band of the first seconds from flattening the rest of the curve."""
    settled = slice(value.size // 10, None)
    reach = 3.0 * np.nanpercentile(sigma[settled], 90.0)
    low = min(np.nanmin(value), np.nanmin(value[settled]) - reach)
    high = max(np.nanmax(value), np.nanmax(value[settled]) + reach)
    margin = 0.08 * max(high - low, 1e-12)
    axes.set_ylim(low - margin, high + margin)


def _thin(*columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """Every k-th element, the last and those that part segments included, about MAX_POINTS in all."""
    size = columns[0].size
    if size <= MAX_POINTS:
        return columns
    even = np.linspace(0, size - 1, MAX_POINTS).astype(np.int64)
    index = np.union1d(even, np.flatnonzero(~np.isfinite(columns[-1])))
    return tuple(column[index] for column in columns)
