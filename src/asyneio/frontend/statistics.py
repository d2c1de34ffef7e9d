"""What a front end counts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrontendStatistics:
    """Counts since the start. `alive`: features tracked now; `ended_*`: why tracks ended."""

    events: int
    hot_pixels: int
    hot_events: int
    corners: int
    tracks: int
    alive: int
    ended_untrusted: int
    ended_silent: int
    ended_border: int
