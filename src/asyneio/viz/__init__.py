# SPDX-License-Identifier: Apache-2.0
"""Plots and the report page.

`viz.data` is the interface: plain arrays that describe a run (`ReportData` and its parts). All plots take
these and know neither the estimator nor files. matplotlib is imported only when something is drawn.
"""

from asyneio.viz.data import (
    Comparison,
    EventRate,
    Features,
    HealthChange,
    HealthTimeline,
    ReportData,
    Series,
    States,
    Timing,
)
from asyneio.viz.report import render_overview, render_pictures, render_report
from asyneio.viz.style import VisualizationError, available
from asyneio.viz.tracks import TrackScene

__all__ = [
    "Comparison",
    "EventRate",
    "Features",
    "HealthChange",
    "HealthTimeline",
    "ReportData",
    "Series",
    "States",
    "Timing",
    "TrackScene",
    "VisualizationError",
    "available",
    "render_overview",
    "render_pictures",
    "render_report",
]
