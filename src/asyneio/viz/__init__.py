"""Plots and the report page. matplotlib is imported only when something is drawn."""

from asyneio.viz.data import Comparison, Features, HealthTimeline, ReportData, Series, Timing
from asyneio.viz.report import render_overview, render_report
from asyneio.viz.style import VisualizationError, available

__all__ = [
    "Comparison",
    "Features",
    "HealthTimeline",
    "ReportData",
    "Series",
    "Timing",
    "VisualizationError",
    "available",
    "render_overview",
    "render_report",
]
