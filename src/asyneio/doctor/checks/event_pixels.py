# SPDX-License-Identifier: Apache-2.0
"""Checks of event pixels: sensor size, hot pixels, polarity, repeated events."""

from __future__ import annotations

from typing import Any

import numpy as np

from asyneio.doctor.event_scan import EventFigures
from asyneio.doctor.inspection import Inspection, note, ok, warning
from asyneio.doctor.inspection import fail as _fail
from asyneio.doctor.result import CheckResult
from asyneio.frontend.surface import make_surface, refresh_hot_pixels
from asyneio.io.parsing.stamp_checks import MAX_BAD_SHARE
from asyneio.types import FloatArray

#: Common sensors by width and height [px].
SENSORS = {
    (128, 128): "DVS128",
    (240, 180): "DAVIS240",
    (304, 240): "ATIS",
    (320, 240): "DVXplorer Lite",
    (320, 320): "GenX320",
    (346, 260): "DAVIS346",
    (640, 480): "DVXplorer or Gen3.1",
    (1280, 720): "Gen4 or IMX636",
    (1280, 800): "CeleX-V",
}
#: If the events cover a smaller fraction of a side than this, the declared size is probably wrong.
_FILLED = 0.8
#: Fewer events need not cover the sensor.
_ENOUGH = 20_000
#: Fraction of events ignored when measuring the extent: hot pixels and bit errors occur anywhere.
_STRAY = 1e-4
#: Fraction of all events from which hot pixels give WARNING; they are masked in any case.
_HOT_SHARE = 0.05
#: Plausible fractions of positive events for common sensor biases.
_BALANCE = (0.15, 0.85)
#: Fractions of events with the pixel and timestamp of another one: a pixel needs microseconds to recover.
_REPEATS, _MANY_REPEATS = 0.001, 0.02
_FEW = 1000


def check_resolution(inspection: Inspection) -> CheckResult | None:
    """Declared sensor size against the extent of the events."""
    events = inspection.events
    if events is None or events.count == 0 or not events.counts.size:
        return None
    width, height = _extent(events)
    fills = f"events reach x = {width - 1}, y = {height - 1}"
    usual = _smallest_sensor(width, height)
    values: dict[str, Any] = {"reach": [width - 1, height - 1], "likely_sensor": usual}
    declared = declared_sizes(inspection)
    if len({size for _, size in declared}) > 1:
        text = ", ".join(f"{who} {w} x {h}" for who, (w, h) in declared)
        return _fail(
            "resolution",
            f"{text}; {fills}",
            "one size",
            f"use the calibration of this camera{_maybe(usual)}",
            **values,
        )
    if not declared:
        return note(
            "resolution",
            f"no file contains it; {fills}{_maybe(usual)}",
            "a resolution in the calibration",
            **values,
        )
    return _against_declared(events, *declared[0], values)


def _against_declared(
    events: EventFigures, who: str, size: tuple[int, int], values: dict[str, Any]
) -> CheckResult:
    """Extent of the events against the single declared size (width, height)."""
    w, h = size
    width, height = _extent(events)
    fills = f"events reach x = {width - 1}, y = {height - 1}"
    usual = values["likely_sensor"]
    outside = int(events.count - events.counts[:h, :w].sum())
    values |= {"declared": [w, h], "outside": outside}
    if outside > MAX_BAD_SHARE * events.count:
        turned = width <= h and height <= w
        cause = "x and y exchanged?" if turned else f"another sensor{_maybe(usual)}"
        return _fail(
            "resolution",
            f"{fills}, but {who} is for {w} x {h}: {outside} events ({outside / events.count:.1%}) outside",
            f"at most {MAX_BAD_SHARE:.0%} of the events outside",
            f"{cause}; give the calibration of this camera",
            **values,
        )
    if events.count >= _ENOUGH and (width < _FILLED * w or height < _FILLED * h):
        return warning(
            "resolution",
            f"{fills}, but {who} is for {w} x {h}",
            "events over the whole sensor",
            f"a calibration of another sensor{_maybe(usual)}, or a region of interest was set",
            **values,
        )
    stray = f"; {outside} event(s) outside are dropped" if outside else ""
    result = note if outside else ok
    return result("resolution", f"{w} x {h} by {who}, {fills}{stray}", **values)


def check_hot_pixels(inspection: Inspection) -> CheckResult | None:
    """Pixels that fire far more often than their neighbours, by the front end's rule."""
    events = inspection.events
    if events is None or events.count < _FEW or events.span_s <= 0.0:
        return None
    hot = hot_pixels(events)
    share = float(events.counts[hot].sum() / events.count)
    rows, columns = np.nonzero(hot)
    order = np.argsort(events.counts[rows, columns])[::-1][:5]
    worst = [
        {
            "x": int(columns[k]),
            "y": int(rows[k]),
            "hz": float(events.counts[rows[k], columns[k]] / events.span_s),
        }
        for k in order
    ]
    values = {"count": int(hot.sum()), "share": share, "worst": worst}
    if not worst:
        return ok("hot pixels", "none", **values)
    first = worst[0]
    measured = (
        f"{hot.sum()} with {share:.2%} of the events, the worst at x = {first['x']}, y = {first['y']}: "
    )
    measured += f"{first['hz']:.4g} Hz"
    if share < _HOT_SHARE or inspection.stationary.throughout:
        # A stationary sensor produces few other events.
        return note("hot pixels", measured, "", "none needed: the front end masks them", **values)
    return warning(
        "hot pixels",
        measured,
        f"less than {_HOT_SHARE:.0%} of the events",
        "the front end masks them; disable them in the sensor to save bandwidth",
        **values,
    )


def hot_pixels(events: EventFigures) -> np.ndarray:
    """Mask (H,W) of hot pixels by the front end's rule, over the whole recording."""
    height, width = events.counts.shape
    surface = make_surface(width, height)
    surface.fired[:] = np.minimum(events.counts, np.iinfo(np.int32).max)
    # At least the front end's interval: a shorter recording has too few events for rates.
    refresh_hot_pixels(surface, max(events.span_s, 1.0))
    return surface.hot.copy()


def check_polarity(inspection: Inspection) -> CheckResult | None:
    """Balance of positive and negative events: the tracker uses the sign."""
    events = inspection.events
    if events is None or events.count < _FEW:
        return None
    share = events.positive / events.count
    measured = f"{share:.1%} positive, {1.0 - share:.1%} negative"
    low, high = _BALANCE
    if low <= share <= high:
        return ok("polarity", measured, positive_share=share)
    lost = share in (0.0, 1.0)
    return warning(
        "polarity",
        measured,
        f"{low:.0%} to {high:.0%} positive",
        "the polarity was lost in a conversion: convert again, the tracker needs it"
        if lost
        else "very different thresholds, or a lamp was switched: check the sensor's biases",
        positive_share=share,
    )


def check_repeats(inspection: Inspection) -> CheckResult | None:
    """Events with the pixel and timestamp of another one: the stream was probably written twice."""
    events = inspection.events
    if events is None or events.count < _FEW:
        return None
    share = events.repeated / events.count
    measured = f"{events.repeated} event(s) ({share:.2%}) with the pixel and timestamp of another event"
    if share <= _REPEATS:
        return ok("repeated events", measured, share=share)
    if share <= _MANY_REPEATS or events.tick_ns > 20_000:
        return note("repeated events", measured, "", "harmless", share=share)
    return warning(
        "repeated events",
        measured,
        f"at most {_MANY_REPEATS:.0%}",
        "the file probably contains the stream twice (two topics, repeated packets): convert it again",
        share=share,
    )


def declared_sizes(inspection: Inspection) -> list[tuple[str, tuple[int, int]]]:
    """Sources of the sensor size, and the size that each declares."""
    declared = [("the recording", inspection.size)] if inspection.size is not None else []
    if inspection.camera is not None and not (inspection.intrinsics_guessed or inspection.size_guessed):
        declared.append(("the calibration", (inspection.camera.width, inspection.camera.height)))
    return declared


def _extent(events: EventFigures) -> tuple[int, int]:
    """Width and height of the area that contains all but a few stray events."""
    return _reach(events.counts.sum(axis=0)), _reach(events.counts.sum(axis=1))


def _reach(counts: FloatArray) -> int:
    beyond = counts.sum() - np.cumsum(counts)
    return int(np.flatnonzero(beyond <= _STRAY * counts.sum())[0]) + 1


def _smallest_sensor(width: int, height: int) -> str:
    """Name of the smallest common sensor with at least this size; empty if none is close."""
    for (w, h), name in sorted(SENSORS.items(), key=lambda item: item[0][0] * item[0][1]):
        if w >= width and h >= height:
            return f"{name}, {w} x {h}" if width > _FILLED * w and height > _FILLED * h else ""
    return ""


def _maybe(sensor: str) -> str:
    return f" (likely {sensor})" if sensor else ""
