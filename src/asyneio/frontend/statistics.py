"""What a front end counts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrontendStatistics:
    """Counts since the start. `alive`: features tracked now; `ended_*`: why tracks ended.

    `untested`: events that might have been corners, beyond the budget of tests. `fed`: events given to
    features, once for each. `shed_*`: what was left out under `frontend.max_load`: events that concern no
    feature, events near features, features.
    """

    events: int
    hot_pixels: int
    hot_events: int
    corners: int
    tracks: int
    alive: int
    ended_untrusted: int
    ended_silent: int
    ended_border: int
    untested: int = 0
    fed: int = 0
    shed_events: int = 0
    shed_feature_events: int = 0
    shed_features: int = 0
