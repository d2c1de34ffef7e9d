# SPDX-License-Identifier: Apache-2.0
"""How a live run treats time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from asyneio.errors import LiveError


@dataclass(frozen=True)
class LiveOptions:
    """How a live run treats time.

    `max_backlog_s`: load is shed so that no data wait longer. `duration_s`: stop after this sensor time;
    None: never. `landmarks`: outputs receive landmarks.

    Raises:
        LiveError: a time is not positive and finite.
    """

    max_backlog_s: float = 0.5
    duration_s: float | None = None
    landmarks: bool = False

    def __post_init__(self) -> None:
        given = {"longest backlog (--max-backlog)": self.max_backlog_s}
        if self.duration_s is not None:
            given["duration (--duration)"] = self.duration_s
        for name, value in given.items():
            if not 0.0 < value < math.inf:
                raise LiveError(f"found {value:g} for the {name}, expected seconds above 0")
