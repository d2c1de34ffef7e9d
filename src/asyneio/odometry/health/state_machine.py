# SPDX-License-Identifier: Apache-2.0
"""Health of the estimator: a state machine that is updated with the metrics of every knot.

INITIALIZING ends with the first window; from then on each knot brings `HealthMetrics`, judged as follows:

| finding                                                      | state                                      |
|--------------------------------------------------------------|--------------------------------------------|
| something required is missing: vision, landmarks, samples    | DEGRADED; the covariance grows accordingly |
| scale was revised by more than its uncertainty allows        | DEGRADED; earlier estimates were wrong     |
| velocity was revised by more than its covariance allows      | DEGRADED; earlier estimates were wrong     |
| scale is too uncertain after an initialization in motion     | DEGRADED; it may still change              |
| an object moved in view during the initialization            | DEGRADED; it may be relative to the object |
| measurements contradict the estimate, or it is too uncertain | DEGRADED; LOST if it lasts                 |
| most new tracks were rejected                                | DEGRADED; LOST if it lasts                 |
| the estimate is impossible                                   | LOST                                       |
| nothing connects this knot with the previous one             | LOST                                       |

DEGRADED becomes TRACKING after some time without any finding. LOST ends the segment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from asyneio.config import HealthConfig
from asyneio.types import NS_PER_S, Health

#: Landmarks observed in an interval below which vision hardly constrains six degrees of freedom: rotation and
#: direction of translation require five bearings (Nister 2004).
MIN_LANDMARKS = 5
#: Mean squared residual per degree of freedom, in declared variances, that noise does not cause: 2.5 standard
#: deviations where 1 is expected (the initialization requires the same).
MAX_RATIO = 2.5**2
#: Share of the observations without influence from which on the majority contradicts the estimate.
MAX_REJECTED_OBSERVATIONS = 0.5
#: Share of the new tracks that were rejected from which on either they or the others are those of a moving
#: object.
MAX_REJECTED_TRACKS = 0.5
#: The estimate is trusted for this share of the time since the segment began, between these multiples of the
#: patience: an initialization that was wrong shows it at once, and an object leaves the view after seconds.
_TRUSTED_SHARE, _LEAST_TRUST, _MOST_TRUST = 0.5, 0.7, 2.0
#: Rejected inertial samples are gaps, which the window weights accordingly; beyond this share the sensor
#: fails or is saturated most of the time.
MAX_REJECTED_SAMPLES = 0.2
#: Largest bias in standard deviations of its prior. With the default priors these are 0.7 rad/s and 1 m/s^2:
#: data sheets of inexpensive sensors allow zero offsets of up to 20 deg/s and 80 mg (MPU-6150, uncorrected),
#: and temperature and mounting add to that.
MAX_BIAS_SIGMAS = 7.0
#: An initialization knows scale to 10 % (`initialization.max_scale_sigma`): a revision by a factor of more
#: than two such standard deviations within `SCALE_MEMORY_S` shows that earlier estimates were wrong.
MAX_SCALE_CHANGE = 1.2
SCALE_MEMORY_S = 2.0
#: A new knot revises the velocity of the knot before by less than its covariance allows: the variance of a
#: revision is the difference of the variances before and after. Quantile 0.9999 of chi-square with 3 degrees
#: of freedom.
MAX_VELOCITY_REVISION = 21.1


@dataclass(frozen=True)
class HealthMetrics:
    """Metrics of one knot; the defaults are those of perfect health.

    Attributes:
        since_vision_s: time since the newest observation [s].
        inertial_gap_s: longest time without a sample of one of the sensors since the previous knot [s].
        rejected_samples: share of the newest packet's inertial samples that the gates rejected.
        saturated: a sensor was at the end of its range.
        landmarks: number of landmarks with an observation in the newest interval.
        rejected_observations: share of those observations beyond the gate.
        rejected_tracks: share of those tracks in the newest interval that began in the last second and that
            the chi-square test has rejected since.
        visual_ratio: squared residuals of the newest interval's observations over their expectation.
        inertial_ratio: the same of its inertial samples.
        scene_changed: all tracks were replaced at once, and the inertial samples jumped.
        speed: of the estimate [m/s].
        bias_sigmas: largest bias in standard deviations of its prior.
        velocity_sigma: largest standard deviation of the velocity over all directions [m/s].
        tilt_sigma_rad: the same of roll and pitch [rad].
        scale_change: relative change of the window's scale within `SCALE_MEMORY_S`.
        velocity_revision: squared Mahalanobis distance of the velocity of the knot before from its previous
            value; 0 after a stationary interval, whose end is detected late.
        scale_sigma: relative standard deviation of scale; 0 once it has been small enough.
        unconfirmed: an object was in view during the initialization, which ended a short time ago.
        finite: pose, velocity and covariance are finite.
        stationary: the sensor is stationary, so that observations are not required.
    """

    since_vision_s: float = 0.0
    inertial_gap_s: float = 0.0
    rejected_samples: float = 0.0
    saturated: bool = False
    landmarks: int = 1000
    rejected_observations: float = 0.0
    rejected_tracks: float = 0.0
    visual_ratio: float = 1.0
    inertial_ratio: float = 1.0
    scene_changed: bool = False
    speed: float = 0.0
    bias_sigmas: float = 0.0
    velocity_sigma: float = 0.0
    tilt_sigma_rad: float = 0.0
    scale_change: float = 0.0
    velocity_revision: float = 0.0
    scale_sigma: float = 0.0
    unconfirmed: bool = False
    finite: bool = True
    stationary: bool = False


class HealthStatus(NamedTuple):
    """State of the estimator and the reason, empty while TRACKING."""

    health: Health
    reason: str


class _Lasting:
    """For how long a finding has lasted."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def update(self, t_ns: int, found: bool) -> float | None:
        """Time [s] since the finding began; None where it is absent."""
        if not found:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = t_ns
        return None if self._since_ns is None else (t_ns - self._since_ns) / NS_PER_S


def _rejected_tracks(metrics: HealthMetrics) -> str:
    return f"{100.0 * metrics.rejected_tracks:.0f} % of the new tracks were rejected"


class HealthStateMachine:
    """The state machine of one segment: begins in TRACKING with the first window, and ends in LOST."""

    def __init__(self, config: HealthConfig) -> None:
        self._config = config
        self.health = Health.TRACKING
        self.reason = ""
        self._degraded_ns: int | None = None
        self._contradiction = _Lasting()
        self._rejected_tracks = _Lasting()
        self._began_ns: int | None = None

    def update(self, t_ns: int, metrics: HealthMetrics) -> HealthStatus:
        """State after the knot at `t_ns` (ascending), and the reason."""
        contradiction = next(self._contradictions(metrics), "")
        lost = next(self._losses(metrics), "") or self._lasting_loss(t_ns, metrics, contradiction)
        finding = contradiction or next(self._shortages(metrics), "")
        if lost:
            self.health, self.reason = Health.LOST, lost
        elif finding:
            self.health, self.reason, self._degraded_ns = Health.DEGRADED, finding, t_ns
        elif self.health is Health.DEGRADED:
            self._recover(t_ns)
        return HealthStatus(self.health, self.reason)

    def _lasting_loss(self, t_ns: int, metrics: HealthMetrics, contradiction: str) -> str:
        """A finding that ends the segment because it has lasted too long; empty if none has."""
        patience_s = self._config.patience_s
        lasting_s = self._contradiction.update(t_ns, bool(contradiction))
        if lasting_s is not None and lasting_s >= patience_s:
            return f"{contradiction}, for {lasting_s:.1f} s"
        many = metrics.rejected_tracks > MAX_REJECTED_TRACKS
        lasting_s = self._rejected_tracks.update(t_ns, many)
        self._began_ns = t_ns if self._began_ns is None else self._began_ns
        trusted_s = _TRUSTED_SHARE * (t_ns - self._began_ns) / NS_PER_S
        trusted_s = min(max(trusted_s, _LEAST_TRUST * patience_s), _MOST_TRUST * patience_s)
        if lasting_s is not None and lasting_s >= trusted_s:
            return f"{_rejected_tracks(metrics)}, for {lasting_s:.1f} s"
        return ""

    def _recover(self, t_ns: int) -> None:
        last_ns = t_ns if self._degraded_ns is None else self._degraded_ns
        if t_ns - last_ns >= self._config.recovery_s * NS_PER_S:
            self.health, self.reason = Health.TRACKING, ""
        elif not self.reason.startswith("recovering"):
            self.reason = f"recovering: {self.reason}"

    def _losses(self, m: HealthMetrics) -> Iterator[str]:
        """Findings that end a segment at once."""
        config = self._config
        if not m.finite:
            yield "the estimate is not finite"
        if m.inertial_gap_s > config.lost_inertial_gap_s:
            yield f"no inertial samples for {m.inertial_gap_s:.2f} s"
        if m.scene_changed:
            yield "all feature tracks were replaced at once: the recording has a cut, or the scene changed"
        if m.speed > config.max_speed:
            yield f"the estimated speed is {m.speed:.0f} m/s"
        if m.bias_sigmas > MAX_BIAS_SIGMAS:
            yield f"an estimated bias is {m.bias_sigmas:.0f} standard deviations of its prior from zero"

    def _shortages(self, m: HealthMetrics) -> Iterator[str]:
        """Findings that something required is missing or wrong."""
        config = self._config
        if m.since_vision_s > config.max_visual_gap_s and not m.stationary:
            yield f"no observations for {m.since_vision_s:.2f} s"
        if m.inertial_gap_s > config.max_inertial_gap_s:
            yield f"no inertial samples for {m.inertial_gap_s:.2f} s"
        if m.landmarks < MIN_LANDMARKS and not m.stationary:
            yield f"{m.landmarks} landmarks in view, {MIN_LANDMARKS} are required"
        if m.rejected_tracks > MAX_REJECTED_TRACKS:
            yield _rejected_tracks(m)
        if m.saturated:
            yield "an inertial sensor is saturated"
        if m.rejected_samples > MAX_REJECTED_SAMPLES:
            yield f"{100.0 * m.rejected_samples:.0f} % of the inertial samples were rejected"
        if abs(math.log1p(m.scale_change)) > math.log(MAX_SCALE_CHANGE):
            yield f"scale was revised by {100.0 * m.scale_change:+.0f} % within {SCALE_MEMORY_S:g} s"
        if m.velocity_revision > MAX_VELOCITY_REVISION:
            yield f"velocity was revised by {math.sqrt(m.velocity_revision):.1f} standard deviations"
        if m.scale_sigma > config.max_scale_sigma:
            yield f"the standard deviation of scale is {100.0 * min(m.scale_sigma, 9.99):.0f} %"
        if m.unconfirmed:
            yield "a moving object was in view during the initialization"

    def _contradictions(self, m: HealthMetrics) -> Iterator[str]:
        """Findings that the estimate is wrong, or too uncertain to be useful."""
        config = self._config
        if m.rejected_observations > MAX_REJECTED_OBSERVATIONS:
            yield f"{100.0 * m.rejected_observations:.0f} % of the observations contradict the estimate"
        if m.visual_ratio > MAX_RATIO:
            yield f"observations deviate by {math.sqrt(m.visual_ratio):.1f} standard deviations"
        if m.inertial_ratio > MAX_RATIO:
            yield f"inertial samples deviate by {math.sqrt(m.inertial_ratio):.1f} standard deviations"
        if m.velocity_sigma > config.max_velocity_sigma:
            yield f"the standard deviation of the velocity is {m.velocity_sigma:.1f} m/s"
        if m.tilt_sigma_rad > math.radians(config.max_tilt_sigma_deg):
            yield f"the standard deviation of roll and pitch is {math.degrees(m.tilt_sigma_rad):.1f} deg"
