# SPDX-License-Identifier: Apache-2.0
"""Images of feature tracks: coloured lines over an image of the latest events."""

from __future__ import annotations

import colorsys
import io
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from asyneio.progress import ProgressCallback
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray
from asyneio.viz.style import plotting, to_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Number of events in an image, as a fraction of the pixels, so that edges are thin at any speed.
_EVENTS_PER_PIXEL = 0.12
#: Time span of the drawn part of a track.
_TRAIL_NS = 400_000_000
#: Number of events of a pixel for full colour.
_FULL = 2.0
#: Unsaturated colours of positive and negative events (as 1 - RGB), so that tracks stand out.
_BRIGHTER = np.array([0.02, 0.22, 0.38])
_DARKER = np.array([0.36, 0.20, 0.03])

_PANELS = 4
_FRAMES = 60
_FRAMES_PER_S = 15.0
_ANIMATION_WIDTH_PX = 640
#: Number of colours of a frame of the animation.
_COLORS = 96
_TITLE_INCHES = 0.3


@dataclass(frozen=True)
class TrackScene:
    """Data to draw: `events` (EVENT_DTYPE, ascending) of a sensor of `width` x `height`, and `observations`
    (OBSERVATION_DTYPE, any order) in the same clock; at least one of each."""

    events: RecordArray
    width: int
    height: int
    observations: RecordArray
    #: Observations sorted by track and time, and first row of each track; computed from `observations`.
    rows: RecordArray = field(init=False)
    start: IntArray = field(init=False)

    def __post_init__(self) -> None:
        rows = self.observations[np.lexsort((self.observations["t_ns"], self.observations["id"]))]
        heads = np.flatnonzero(np.r_[True, rows["id"][1:] != rows["id"][:-1]])
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "start", np.append(heads, rows.size))

    def trails(self, t_ns: int) -> list[tuple[int, FloatArray]]:
        """Id and pixels (K,2), oldest first, of each live track at a time."""
        stamps = self.rows["t_ns"]
        alive = (stamps[self.start[:-1]] <= t_ns) & (stamps[self.start[1:] - 1] >= t_ns)
        found = []
        for k in np.flatnonzero(alive):
            part = self.rows[self.start[k] : self.start[k + 1]]
            part = part[(part["t_ns"] <= t_ns) & (part["t_ns"] >= t_ns - _TRAIL_NS)]
            if part.size:
                found.append((int(part["id"][0]), np.column_stack([part["u"], part["v"]])))
        return found

    def image(self, t_ns: int) -> FloatArray:
        """Image (H,W,3) of the last events before a time."""
        end = int(np.searchsorted(self.events["t_ns"], t_ns, side="right"))
        wanted = round(_EVENTS_PER_PIXEL * self.width * self.height)
        shown = np.asarray(self.events[max(end - wanted, 0) : end])
        signed = np.zeros((self.height, self.width))
        np.add.at(signed, (shown["y"], shown["x"]), np.where(shown["p"] > 0, 1.0, -1.0))
        strength = np.clip(signed / _FULL, -1.0, 1.0)[..., None]
        return 1.0 - np.maximum(strength, 0.0) * _BRIGHTER - np.maximum(-strength, 0.0) * _DARKER


def render_tracks(scene: TrackScene, title: str) -> bytes:
    """Tracks at several instants of a recording, as a PNG file.

    Raises:
        VisualizationError: matplotlib is not installed.
    """
    with plotting():
        figure = plot_tracks(scene, 10.0)
        figure.suptitle(title, fontsize=10)
        return to_png(figure)


def plot_tracks(scene: TrackScene, width: float) -> Figure:
    """Tracks at several instants, `width` inches wide; to be called inside `style.plotting()`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, width * scene.height / scene.width + 0.9), layout="constrained")
    instants = shown_instants(scene.events["t_ns"])
    for axes, t_ns in zip(np.ravel(figure.subplots(2, _PANELS // 2)), instants, strict=True):
        draw_tracks(axes, scene, t_ns)
    return figure


def shown_instants(t_ns: IntArray) -> list[int]:
    """Times [ns] shown by `plot_tracks` for events at `t_ns` (N,), ascending, at least one."""
    begin, span = int(t_ns[0]), int(t_ns[-1]) - int(t_ns[0])
    return [begin + span * (k + 1) // (_PANELS + 1) for k in range(_PANELS)]


def render_animation(scene: TrackScene, advance: ProgressCallback | None = None) -> bytes:
    """A GIF file of four seconds: the middle of a longer recording in real time, or a shorter one slowed
    down.

    `advance` is called with the fraction done, 0 to 1.

    Raises:
        VisualizationError: matplotlib is not installed.
    """
    from PIL import Image

    with plotting():
        begin, span = _span(scene)
        shown = min(span, round(_FRAMES / _FRAMES_PER_S * NS_PER_S))
        first = begin + (span - shown) // 2
        frames = []
        for k in range(_FRAMES):
            frame = Image.fromarray(_frame(scene, first + shown * (k + 1) // _FRAMES))
            frames.append(frame.quantize(_COLORS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE))
            if advance:
                advance((k + 1) / _FRAMES)
    buffer = io.BytesIO()
    frames[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=round(1000.0 / _FRAMES_PER_S),
        loop=0,
    )
    return buffer.getvalue()


def _span(scene: TrackScene) -> tuple[int, int]:
    """First time and duration of the events [ns]."""
    first = int(scene.events["t_ns"][0])
    return first, int(scene.events["t_ns"][-1]) - first


def _frame(scene: TrackScene, t_ns: int) -> np.ndarray:
    """One frame (H,W,3) of bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    wide = _ANIMATION_WIDTH_PX / 100.0
    high = wide * scene.height / scene.width
    figure: Figure = Figure(figsize=(wide, high + _TITLE_INCHES), dpi=100)
    canvas = FigureCanvasAgg(figure)
    # Explicit positions: a layout engine would take most of the time.
    draw_tracks(figure.add_axes((0.0, 0.0, 1.0, high / (high + _TITLE_INCHES))), scene, t_ns)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]


def draw_tracks(axes: Axes, scene: TrackScene, t_ns: int) -> None:
    """The live tracks at a time [ns] over the events before it."""
    from matplotlib.collections import LineCollection

    trails = scene.trails(t_ns)
    # Position (0, 0) is the centre of the top left pixel, as in imshow.
    axes.imshow(scene.image(t_ns), interpolation="nearest")
    colors = [_color(identity) for identity, _ in trails]
    axes.add_collection(LineCollection([uv for _, uv in trails], colors=colors, linewidths=1.3))
    if trails:
        heads = np.array([uv[-1] for _, uv in trails])
        axes.scatter(heads[:, 0], heads[:, 1], s=9.0, c=colors, linewidths=0.0, zorder=3)
    axes.set(xlim=(-0.5, scene.width - 0.5), ylim=(scene.height - 0.5, -0.5), xticks=[], yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set_visible(True)
    since_s = (t_ns - int(scene.events["t_ns"][0])) / NS_PER_S
    axes.set_title(f"{since_s:.3f} s: {len(trails)} tracks", fontsize=9, fontweight="normal")


def _color(identity: int) -> tuple[float, float, float]:
    """Colour of a track; consecutive ids get distant hues by steps of the golden ratio."""
    return colorsys.hsv_to_rgb((identity * 0.618034) % 1.0, 0.95, 0.72)
