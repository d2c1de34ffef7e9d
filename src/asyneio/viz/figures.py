# SPDX-License-Identifier: Apache-2.0
"""The figures of a report, as far as there are data for them, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asyneio.types import FloatArray
from asyneio.viz import paths, plots
from asyneio.viz.data import Comparison, ReportData, States, finite_rows
from asyneio.viz.space import Space, plot_space, space_of
from asyneio.viz.style import ESTIMATE, WIDTH
from asyneio.viz.tracks import draw_tracks, plot_tracks, shown_instants

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Maximum number of paths in separate worlds that are drawn; of more, the longest.
_MOST_PATHS = 4


@dataclass(frozen=True)
class ReportFigure:
    """A figure: `name` of its file, title, caption and the function that draws it (inside
    `style.plotting()`).

    `space` is the interactive view of the page's script; `raster`: to be stored as pixels.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]
    space: Space | None = None
    raster: bool = False


def report_figures(data: ReportData) -> Iterator[ReportFigure]:
    """The figures of a run."""
    if data.states is not None:
        yield from _paths(data.states, data.comparison)
        if data.comparison is not None:
            yield from _errors(data.comparison)
        yield from _states(data.states)
    states = "Health of the estimator; dashed lines: a new segment with its own world begins."
    yield ReportFigure("health", "Health", states, lambda: plots.plot_health(data.health))
    alive = "Number of live tracks at each step, and their age."
    yield ReportFigure("features", "Features", alive, lambda: plots.plot_features(data.features))
    events = data.events
    if events is not None:
        rate = "Event rate of the camera, per packet."
        yield ReportFigure("events", "Event rate", rate, lambda: plots.plot_events(events))
    scene = data.scene
    if scene is not None:
        look = "Coloured lines: feature tracks of the last 0.4 s, over the latest events."
        yield ReportFigure(
            "tracks", "Events and tracks", look, lambda: plot_tracks(scene, WIDTH), raster=True
        )
    cost = "Per knot, without compilation; the time for tracking is in the table."
    yield ReportFigure("timing", "Processing time", cost, lambda: plots.plot_timing(data.timing))


def plot_overview(data: ReportData) -> Figure | None:
    """Overview of a run: events and tracks, the path, and its errors or uncertainty.

    None without estimates.
    """
    from matplotlib.figure import Figure

    if data.states is None or not any(map(_drawable, data.states.paths)):
        return None
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    upper, lower = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(1.15, 1.0))))
    left, right = upper.subplots(1, 2)
    if data.scene is not None:
        draw_tracks(left, data.scene, shown_instants(data.scene.events["t_ns"])[1])
    else:
        left.plot(data.features.t_s, data.features.alive, color=ESTIMATE)
        left.set(xlabel="time [s]", ylabel="tracks alive", ylim=(0.0, None))
    truth = data.comparison
    shown = truth.position_estimate if truth else max(data.states.paths, key=len)
    paths.draw_path(right, shown, truth.position_truth if truth else None, 1)
    right.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    right.set_adjustable("datalim")
    right.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    panels = list(lower.subplots(3, 1, sharex=True))
    if truth:
        plots.draw_errors(panels, truth.position_error.scaled(100.0), "cm")
        panels[0].set_title("position error and 3 sigma", fontweight="normal", fontsize=9)
    else:
        plots.draw_vector(panels, data.states.velocity, "m/s")
        panels[0].set_title("velocity and 3 sigma", fontweight="normal", fontsize=9)
    return figure


def _paths(states: States, truth: Comparison | None) -> Iterator[ReportFigure]:
    several = len(states.paths) > 1
    if truth is not None:
        if _drawable(truth.position_estimate):
            aligned = "Aligned with the ground truth in position and yaw"
            aligned += ", each segment individually." if several else "."
            yield from _path("path", "Path", aligned, truth.position_estimate, truth)
        return
    longest = sorted(range(len(states.paths)), key=lambda n: -len(states.paths[n]))[:_MOST_PATHS]
    for number in sorted(longest):
        if not _drawable(states.paths[number]):
            continue
        title = f"Path of segment {number}" if several else "Path"
        caption = "In the estimator's own world, z up."
        if len(states.paths) > _MOST_PATHS:
            caption += f" The {_MOST_PATHS} longest of {len(states.paths)} segments are drawn."
        name = f"path_{number}" if number else "path"
        yield from _path(name, title, caption, states.paths[number], None)


def _path(
    name: str, title: str, caption: str, position: FloatArray, truth: Comparison | None
) -> Iterator[ReportFigure]:
    yield ReportFigure(name, title, caption, lambda: paths.plot_path(position, truth))
    space = space_of(position, truth.position_truth if truth else None)
    hint = "With its shadow on the floor. Drag to rotate; pinch, or + and -, to zoom; double-click to reset."
    yield ReportFigure(
        name.replace("path", "space"), f"{title} in space", hint, lambda: plot_space(space), space
    )


def _drawable(position: FloatArray) -> bool:
    return finite_rows(position).size > 0


def _errors(truth: Comparison) -> Iterator[ReportFigure]:
    relative = "Relative to the first estimate; the band is the estimated 3-sigma uncertainty."
    yield ReportFigure(
        "position_error", "Position error", relative, lambda: plots.plot_errors(truth.position_error, "m")
    )
    yield ReportFigure(
        "orientation_error",
        "Orientation error",
        f"About the body axes. {relative}",
        lambda: plots.plot_errors(truth.orientation_error, "deg"),
    )


def _states(states: States) -> Iterator[ReportFigure]:
    yield ReportFigure(
        "velocity", "Velocity", "World axes.", lambda: plots.plot_vector(states.velocity, "m/s")
    )
    yield ReportFigure(
        "gyroscope_bias",
        "Gyroscope bias",
        "Body axes.",
        lambda: plots.plot_vector(states.bias_gyroscope.scaled(1e3), "mrad/s"),
    )
    yield ReportFigure(
        "accelerometer_bias",
        "Accelerometer bias",
        "Body axes.",
        lambda: plots.plot_vector(states.bias_accelerometer, "m/s²"),
    )
