"""Health of the estimator: a state machine over what one knot knows of itself.

INITIALIZING is left by a start; from then on each knot brings `HealthMetrics`, judged as follows:

| finding                                                      | state                                      |
|--------------------------------------------------------------|--------------------------------------------|
| something needed is missing: vision, landmarks, IMU samples  | DEGRADED; the covariance grows by itself   |
| scale was revised by more than its uncertainty allows        | DEGRADED: what was given out was not right |
| measurements contradict the estimate, or it is too uncertain | DEGRADED, LOST if it goes on               |
| the estimate is impossible                                   | LOST                                       |
| nothing connects this knot with the one before               | LOST                                       |

DEGRADED becomes TRACKING only after some time without any finding. LOST ends the segment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from asyneio.config import HealthConfig
from asyneio.types import NS_PER_S, Health

#: Landmarks seen in a knot interval below which vision hardly constrains six degrees of freedom: rotation and
#: direction of translation take five bearings (Nister 2004).
MIN_LANDMARKS = 5
#: Mean squared residual per degree of freedom, in declared variances, that no noise gives: 2.5 standard
#: deviations where 1 is right (the start asks for the same).
MAX_RATIO = 2.5**2
#: More observations without any influence than with: the majority speaks against the estimate.
MAX_REJECTED = 0.5
#: Refused inertial samples are gaps, which the window weighs as such; beyond this share the sensor is failing
#: or saturated most of the time.
MAX_GATED = 0.2
#: Biases further from zero than so many of their prior's standard deviations. With the default priors these
#: are 0.7 rad/s and 1 m/s^2: data sheets of inexpensive sensors give zero offsets of up to 20 deg/s and 80
#: mg (MPU-6150, before correction), and temperature and mounting add to that.
MAX_BIAS_SIGMAS = 7.0
#: Scale of a right start is known to 10 % (`initialization.max_scale_sigma`): a revision by a factor that is
#: more than two such standard deviations, within `SCALE_MEMORY_S`, says that what was given out was wrong.
MAX_SCALE_CHANGE = 1.2
SCALE_MEMORY_S = 2.0


@dataclass(frozen=True)
class HealthMetrics:
    """What one knot knows of itself; every default is the value of perfect health.

    `since_vision_s`: since the newest observation. `inertial_gap_s`: longest time since the knot before (and
    up to this one) without a sample of one of the sensors. `gated`: share of samples that were refused.
    `landmarks` with an observation in the newest interval, and what share of those observations was
    `rejected`. `visual_ratio`, `inertial_ratio`: squared residuals of the newest interval over what the
    declared noise lets expect. `saturated`: a sensor read the end of its range. `renewed`: all
    tracks at once are new ones.
    `bias_sigmas`: largest bias in
    standard deviations of its prior. `scale_change`: relative, of the last `SCALE_MEMORY_S`. Sigmas are of
    the estimate [m/s, rad], speed in m/s. `still`: at rest, where vision says nothing and is not missed.
    """

    since_vision_s: float = 0.0
    inertial_gap_s: float = 0.0
    gated: float = 0.0
    saturated: bool = False
    landmarks: int = 1000
    rejected: float = 0.0
    visual_ratio: float = 1.0
    inertial_ratio: float = 1.0
    renewed: bool = False
    speed: float = 0.0
    bias_sigmas: float = 0.0
    velocity_sigma: float = 0.0
    tilt_sigma_rad: float = 0.0
    scale_change: float = 0.0
    finite: bool = True
    still: bool = False


class HealthStateMachine:
    """The state machine of one segment: begins as TRACKING, at its start, and ends LOST."""

    def __init__(self, config: HealthConfig) -> None:
        self._config = config
        self.health = Health.TRACKING
        self.reason = ""
        self._complaint_ns: int | None = None
        self._doubt_ns: int | None = None

    def update(self, t_ns: int, vitals: HealthMetrics) -> tuple[Health, str]:
        """State after the knot at `t_ns` (ascending), and why, in words; no reason while TRACKING."""
        doubt = next(self._doubts(vitals), "")
        if not doubt:
            self._doubt_ns = None
        elif self._doubt_ns is None:
            self._doubt_ns = t_ns
        lost = next(self._losses(vitals), "")
        if not lost and self._doubt_ns is not None:
            lasting_s = (t_ns - self._doubt_ns) / NS_PER_S
            lost = f"{doubt}, for {lasting_s:.1f} s" if lasting_s >= self._config.patience_s else ""
        complaint = doubt or next(self._shortages(vitals), "")
        if lost:
            self.health, self.reason = Health.LOST, lost
        elif complaint:
            self.health, self.reason, self._complaint_ns = Health.DEGRADED, complaint, t_ns
        elif self.health is Health.DEGRADED:
            self._recover(t_ns)
        return self.health, self.reason

    def _recover(self, t_ns: int) -> None:
        last_ns = t_ns if self._complaint_ns is None else self._complaint_ns
        if t_ns - last_ns >= self._config.recovery_s * NS_PER_S:
            self.health, self.reason = Health.TRACKING, ""
        elif not self.reason.startswith("recovering"):
            self.reason = f"recovering: {self.reason}"

    def _losses(self, v: HealthMetrics) -> Iterator[str]:
        """What ends a segment at once."""
        config = self._config
        if not v.finite:
            yield "the estimate is not finite"
        if v.inertial_gap_s > config.lost_inertial_gap_s:
            yield f"no inertial samples for {v.inertial_gap_s:.2f} s"
        if v.renewed:
            yield "all feature tracks were replaced at once: the stream is cut, or the scene changed"
        if v.speed > config.max_speed:
            yield f"speed of {v.speed:.0f} m/s"
        if v.bias_sigmas > MAX_BIAS_SIGMAS:
            yield f"a bias of {v.bias_sigmas:.0f} standard deviations of its prior"

    def _shortages(self, v: HealthMetrics) -> Iterator[str]:
        """What is missing or in doubt."""
        config = self._config
        if v.since_vision_s > config.max_visual_gap_s and not v.still:
            yield f"no observations for {v.since_vision_s:.2f} s"
        if v.inertial_gap_s > config.max_inertial_gap_s:
            yield f"no inertial samples for {v.inertial_gap_s:.2f} s"
        if v.landmarks < MIN_LANDMARKS and not v.still:
            yield f"{v.landmarks} landmarks in view, {MIN_LANDMARKS} are needed"
        if v.saturated:
            yield "an inertial sensor is at the end of its range"
        if v.gated > MAX_GATED:
            yield f"{100.0 * v.gated:.0f} % of the inertial samples were refused"
        if abs(math.log1p(v.scale_change)) > math.log(MAX_SCALE_CHANGE):
            yield f"scale was revised by {100.0 * v.scale_change:+.0f} % within {SCALE_MEMORY_S:g} s"

    def _doubts(self, v: HealthMetrics) -> Iterator[str]:
        """What speaks against the estimate, or makes it useless."""
        config = self._config
        if v.rejected > MAX_REJECTED:
            yield f"{100.0 * v.rejected:.0f} % of the observations contradict the estimate"
        if v.visual_ratio > MAX_RATIO:
            yield f"observations are off by {math.sqrt(v.visual_ratio):.1f} standard deviations"
        if v.inertial_ratio > MAX_RATIO:
            yield f"inertial samples are off by {math.sqrt(v.inertial_ratio):.1f} standard deviations"
        if v.velocity_sigma > config.max_velocity_sigma:
            yield f"velocity is known to {v.velocity_sigma:.1f} m/s only"
        if v.tilt_sigma_rad > math.radians(config.max_tilt_sigma_deg):
            yield f"roll and pitch are known to {math.degrees(v.tilt_sigma_rad):.1f} deg only"
