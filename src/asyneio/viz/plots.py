# SPDX-License-Identifier: Apache-2.0
"""Plots of a report over time, from plain arrays to a figure; to be called inside `style.plotting()`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asyneio.types import FloatArray
from asyneio.viz.data import EventRate, Features, HealthTimeline, Series, Timing
from asyneio.viz.style import ACCENT, AXES_COLORS, ESTIMATE, FAINT, HEALTH_COLORS, TRUTH, new_figure
from asyneio.viz.thinning import envelope, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_XYZ = ("x", "y", "z")
#: Event rate from which the axis is in millions [events/s].
_MEGA = 2e5
#: Maximum number of drawn periods of one state; more would be narrower than a line.
_MOST_PERIODS = 1500


def plot_errors(series: Series, unit: str) -> Figure:
    """Error of each axis over time inside its three-sigma band."""
    figure, panels = new_figure(3, 3.9)
    draw_errors(panels, series, unit)
    panels[0].set_title("error and 3 sigma", fontweight="normal", fontsize=9)
    return figure


def draw_errors(panels: list[Axes], series: Series, unit: str) -> None:
    """Draw the same into three panels."""
    for axis, axes in enumerate(panels):
        t_s, error, sigma = thin(series.t_s, series.value[:, axis], series.sigma[:, axis])
        _band(axes, t_s, np.zeros_like(t_s), sigma, AXES_COLORS[axis])
        axes.plot(t_s, error, color=AXES_COLORS[axis])
        axes.axhline(0.0, color=FAINT, linewidth=0.6)
        axes.set_ylabel(f"{_XYZ[axis]} [{unit}]")
    panels[-1].set_xlabel("time [s]")


def plot_vector(series: Series, unit: str) -> Figure:
    """Value of each axis over time with its three-sigma band, and the ground truth if known."""
    figure, panels = new_figure(3, 3.9)
    draw_vector(panels, series, unit)
    known = "value, 3 sigma and ground truth (grey)" if series.truth is not None else "value and 3 sigma"
    panels[0].set_title(known, fontweight="normal", fontsize=9)
    return figure


def draw_vector(panels: list[Axes], series: Series, unit: str) -> None:
    """Draw the same into three panels."""
    for axis, axes in enumerate(panels):
        t_s, value, sigma = thin(series.t_s, series.value[:, axis], series.sigma[:, axis])
        if series.truth is not None:
            axes.plot(*thin(series.t_s, series.truth[:, axis]), color=TRUTH, linewidth=2.4, alpha=0.45)
        _band(axes, t_s, value, sigma, AXES_COLORS[axis])
        axes.plot(t_s, value, color=AXES_COLORS[axis])
        _limit_to_settled(axes, value, sigma)
        axes.set_ylabel(f"{_XYZ[axis]} [{unit}]")
    panels[-1].set_xlabel("time [s]")


def plot_features(features: Features) -> Figure:
    """Number of live tracks, and their ages."""
    figure, (count, age) = new_figure(2, 3.2)
    t_s, low, middle, high = envelope(features.t_s, features.alive.astype(np.float64))
    count.fill_between(t_s, low, high, color=ESTIMATE, alpha=0.25, linewidth=0.0)
    count.plot(t_s, middle, color=ESTIMATE)
    count.set(ylabel="tracks alive", ylim=(0.0, max(1.08 * np.max(high, initial=0.0), 1.0)))
    # No age without tracks; the upper panel shows their number.
    known = np.isfinite(features.age_s).all(axis=1)
    t_s, low, middle, high = thin(features.t_s[known], *features.age_s[known].T)
    age.fill_between(t_s, low, high, color=AXES_COLORS[1], alpha=0.2, linewidth=0.0, label="quartiles")
    age.plot(t_s, middle, color=AXES_COLORS[1], label="median")
    # Room above for the legend.
    age.set(ylabel="age [s]", xlabel="time [s]", ylim=(0.0, max(1.35 * np.max(high, initial=0.0), 1e-3)))
    age.legend(ncols=2, loc="upper right")
    return figure


def plot_events(events: EventRate) -> Figure:
    """Event rate over time; the band is from the minimum to the maximum of the packets."""
    figure, (axes,) = new_figure(1, 2.1)
    t_s, low, middle, high = envelope(events.t_s, events.rate)
    mega = np.max(high, initial=0.0) >= _MEGA
    unit = 1e6 if mega else 1e3
    axes.fill_between(t_s, low / unit, high / unit, color=ESTIMATE, alpha=0.25, linewidth=0.0)
    axes.plot(t_s, middle / unit, color=ESTIMATE)
    axes.set(xlabel="time [s]", ylabel=f"{'million' if mega else 'thousand'} events/s", ylim=(0.0, None))
    return figure


def plot_health(health: HealthTimeline) -> Figure:
    """Health over time, one row per state; borders of segments as dashed lines."""
    figure, (axes,) = new_figure(1, 1.8, left=0.85)
    step_s = float(np.median(np.diff(health.t_s))) if health.t_s.size > 1 else 0.1
    heads = np.flatnonzero(np.r_[True, np.diff(health.state) != 0])
    ends = np.r_[heads[1:], health.t_s.size] - 1
    for row in range(len(health.names)):
        own = np.flatnonzero(health.state[heads] == row)
        begin_s = health.t_s[heads[own]] - step_s
        length_s = health.t_s[ends[own]] - begin_s
        # Only the longest of many periods; shorter ones are not visible.
        kept = np.argsort(-length_s, kind="stable")[:_MOST_PERIODS]
        periods = np.column_stack([begin_s, length_s])[kept]
        color = HEALTH_COLORS[row % len(HEALTH_COLORS)]
        axes.broken_barh(
            periods.tolist(), (row - 0.35, 0.7), facecolors=color, edgecolors=color, linewidth=0.5
        )
    for border in np.flatnonzero(np.diff(health.segment) != 0)[:_MOST_PERIODS]:
        axes.axvline(float(health.t_s[border]), color=TRUTH, linestyle="--", linewidth=1.0)
    axes.set_yticks(range(len(health.names)), health.names)
    axes.set(xlabel="time [s]", ylim=(-0.6, len(health.names) - 0.4))
    return figure


def plot_timing(timing: Timing) -> Figure:
    """Processing time of each step against its real-time limit; the band is up to the slowest."""
    figure, (axes,) = new_figure(1, 2.3)
    t_s, low, middle, high = envelope(timing.t_s, 1e3 * timing.step_s)
    budget_ms = 1e3 * timing.interval_s
    axes.fill_between(t_s, low, high, color=ESTIMATE, alpha=0.25, linewidth=0.0)
    axes.plot(t_s, middle, color=ESTIMATE, linewidth=0.8, label="one step")
    axes.axhline(budget_ms, color=ACCENT, linestyle="--", label=f"real time ({budget_ms:.0f} ms)")
    axes.set(xlabel="time [s]", ylabel="processing [ms]", yscale="log")
    slowest = float(np.max(high, initial=budget_ms))
    fastest = float(np.percentile(middle, 1.0)) if middle.size else budget_ms
    # Limits at whole decades, so that the axis has at least two labels.
    floor = 10.0 ** np.floor(np.log10(np.clip(fastest, 1e-3, 0.3 * budget_ms)))
    axes.set_ylim(floor, 3.5 * slowest)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.legend(ncols=2, loc="upper right")
    return figure


def _band(axes: Axes, t_s: FloatArray, middle: FloatArray, sigma: FloatArray, color: str) -> None:
    reach = np.where(np.isfinite(middle), 3.0 * sigma, np.nan)
    axes.fill_between(t_s, middle - reach, middle + reach, color=color, alpha=0.15, linewidth=0.0)


def _limit_to_settled(axes: Axes, value: FloatArray, sigma: FloatArray) -> None:
    """Limit the axis so that a wide band in the first seconds does not flatten the rest of the curve."""
    finite = np.isfinite(value) & np.isfinite(sigma)
    settled = finite & (np.arange(value.size) >= value.size // 10)
    if not settled.any():
        return
    reach = 3.0 * np.percentile(sigma[settled], 90.0)
    low = min(value[finite].min(), value[settled].min() - reach)
    high = max(value[finite].max(), value[settled].max() + reach)
    margin = 0.08 * max(high - low, 1e-12)
    axes.set_ylim(low - margin, high + margin)
