"""What an event simulation simulates: one frozen record, and ready-made ones by name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.events.sensor import SensorSpec
from asyneio.simulation.imu_sensors import imu_named
from asyneio.simulation.recorded_path import RecordedRun
from asyneio.simulation.tracks.scenario import RigScenario, with_imu
from asyneio.types import NS_PER_S, ImuNoise, IntArray

_DAVIS = SensorSpec()
#: A few lux: slow photoreceptors, much noise.
_DIM = SensorSpec(threshold_on=0.30, threshold_off=0.27, shot_noise_hz=5.0, hot_pixels=20, leak_hz=0.2)


class Person(StrEnum):
    """Whether a box of a person's size is in front of the camera, and what it does there."""

    NOBODY = "nobody"
    STANDING = "standing"
    WALKING = "walking"


@dataclass(frozen=True)
class EventScenario(RigScenario):
    """One simulated run of an event camera with an IMU.

    `world` names a `WorldKind`; `photographs`: textures are photographs instead of the built-in ones.
    `motion_scale` multiplies the positions of the motion (a small world needs small ones). A `recorded` run
    replaces motion and IMU (see `along`); it is never scaled. `illumination`: intensity of light, 1 in an
    office; `sunlit`: how many times brighter patches of sun are. Of the light the share `flicker_depth` is of
    lamps that flicker as a rectified sine at `flicker_hz`, twice the frequency of the mains (100 or 120); its
    mean stays. The image moves at most `largest_step_px` between two renderings, which are at most
    `longest_step_s` apart. `person` names a `Person`, who is in the way at `person_spot_m` on average; motion
    and world do not depend on it.
    """

    name: str = "event_slow"
    motion: str = "gentle"
    recorded: RecordedRun | None = None
    world: str = "room"
    photographs: bool = False
    motion_scale: float = 1.0
    sensor: SensorSpec = _DAVIS
    illumination: float = 1.0
    sunlit: float = 1.0
    flicker_hz: float = 100.0
    flicker_depth: float = 0.0
    person: str = "nobody"
    person_spot_m: tuple[float, float, float] = (1.1, 0.0, -0.5)
    largest_step_px: float = 0.2
    longest_step_s: float = 0.010
    accelerometer_rate_hz: float = 1000.0
    accelerometer_offset_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        positive = {
            "motion_scale": self.motion_scale,
            "illumination": self.illumination,
            "sunlit": self.sunlit,
            "largest_step_px": self.largest_step_px,
            "longest_step_s": self.longest_step_s,
        }
        wrong = [f"{name} = {value}" for name, value in positive.items() if not value > 0.0]
        if wrong:
            raise SimulationError(f"{', '.join(wrong)}; expected a positive value")
        if not 0.0 <= self.flicker_depth <= 1.0 or not 0.0 < self.flicker_hz <= 1000.0:
            raise SimulationError(
                f"flicker_depth = {self.flicker_depth} at flicker_hz = {self.flicker_hz}; expected a share "
                "of 0 to 1 and a frequency up to 1000 Hz"
            )
        if self.person not in list(Person):
            raise SimulationError(f"person {self.person!r} is unknown; expected one of {', '.join(Person)}")
        if self.recorded is not None and self.motion_scale != 1.0:
            raise SimulationError(
                f"motion_scale = {self.motion_scale} with a recorded motion, which keeps its size: use "
                "motion_scale = 1 and a larger world, such as 'around'"
            )

    def along(self, recorded: RecordedRun, noise: ImuNoise) -> EventScenario:
        """This scenario along a recorded way, in a room around it, with the samples of the IMU that went it.

        Args:
            recorded: motion and samples.
            noise: of that IMU.
        """
        scenario = replace(
            self,
            recorded=recorded,
            start_ns=recorded.start_ns,
            duration_s=recorded.duration_s,
            world="around",
            motion_scale=1.0,
            noise=noise,
        )
        if recorded.samples is None:
            return scenario
        streams = recorded.samples.gyroscope, recorded.samples.accelerometer
        rates = [_rate_of(stream["t_ns"]) for stream in streams]
        return replace(scenario, gyroscope_rate_hz=rates[0], accelerometer_rate_hz=rates[1])


def _rate_of(t_ns: IntArray) -> float:
    """Rate of a stream [Hz], by the median of its steps."""
    return NS_PER_S / float(np.median(np.diff(t_ns)))


_SLOW = EventScenario()

#: What the scenarios of the suite have in common: length, and the IMU of that camera.
_SUITE = with_imu(replace(_SLOW, duration_s=30.0), imu_named("MPU-6150"))
#: A lamp in a dim room.
_HDR = {"illumination": 0.1, "sunlit": 60.0}


def _suite(
    seed: int,
    name: str,
    world: str,
    motion: str,
    scale: float,
    illumination: float = 1.0,
    sunlit: float = 1.0,
) -> EventScenario:
    return replace(
        _SUITE,
        seed=seed,
        name=f"suite_{name}",
        world=world,
        motion=motion,
        motion_scale=scale,
        illumination=illumination,
        sunlit=sunlit,
    )


#: Sequences of the kinds of the DAVIS240C data set (Mueggler et al. 2017), with its camera, clock and IMU.
#: Each has a seed of its own, so that no two share their motion.
SUITE: tuple[EventScenario, ...] = (
    _suite(0, "boxes_6dof", "boxes", "six_dof", 1.0),
    _suite(1, "boxes_translation", "boxes", "translation", 1.0),
    _suite(2, "hdr_boxes", "boxes", "six_dof", 1.0, **_HDR),
    _suite(3, "poster_6dof", "poster", "six_dof", 0.85),
    _suite(4, "poster_translation", "poster", "translation", 0.85),
    _suite(5, "hdr_poster", "poster", "six_dof", 0.85, **_HDR),
    replace(_suite(6, "dynamic_6dof", "room", "six_dof", 0.55), person="walking"),
    # Further away: where the camera does not turn, the person makes most of the events.
    replace(
        _suite(7, "dynamic_translation", "room", "translation", 0.55),
        person="walking",
        person_spot_m=(1.7, 0.0, -0.5),
    ),
    replace(_suite(8, "low_light", "room", "six_dof", 1.0, illumination=0.03), sensor=_DIM),
)

#: The dynamic ones with nobody in them, and with somebody who stands still: what the walking costs.
TWINS: tuple[EventScenario, ...] = tuple(
    replace(scenario, name=f"{scenario.name}_{person}", person=person)
    for scenario in SUITE
    if scenario.person != Person.NOBODY
    for person in (Person.NOBODY, Person.STANDING)
)


def at_resolution(scenario: EventScenario, width: int, height: int) -> EventScenario:
    """The same run seen by another sensor behind the same lens: the view is as wide, pixels are square as
    they were; a wider shape loses rows at top and bottom.

    Args:
        scenario: of any sensor.
        width, height: of the new one [px].
    """
    old = scenario.camera
    scale = width / old.width
    # The centre of a pixel lies half a pixel inside its border; the lens looks through the same place.
    camera = replace(
        old,
        fx=scale * old.fx,
        fy=scale * old.fy,
        cx=scale * (old.cx + 0.5) - 0.5,
        cy=scale * (old.cy + 0.5 - 0.5 * old.height) + 0.5 * height - 0.5,
        width=width,
        height=height,
    )
    return replace(scenario, name=f"{scenario.name}_{width}x{height}", camera=camera)


#: The boxes of the suite with finer print, and the same seen by sensors of today.
_FINE = _suite(0, "fine_6dof", "fine", "six_dof", 1.0)
RESOLUTIONS: tuple[EventScenario, ...] = (
    _FINE,
    at_resolution(_FINE, 640, 480),
    at_resolution(_FINE, 1280, 720),
)

#: Ready-made event scenarios by name; vary them with `dataclasses.replace`.
EVENT_SCENARIOS: dict[str, EventScenario] = {
    scenario.name: scenario
    for scenario in (
        _SLOW,
        replace(_SLOW, name="event_room", motion="moderate"),
        replace(_SLOW, name="event_fast", motion="aggressive"),
        replace(_SLOW, name="event_rotation", motion="rotation"),
        replace(_SLOW, name="event_low_light", motion="moderate", sensor=_DIM, illumination=0.03),
        replace(_SLOW, name="event_near", world="near", motion="moderate", motion_scale=0.3),
        replace(_SLOW, name="event_far", world="far", motion="moderate", motion_scale=2.0),
        replace(_SLOW, name="event_hdr", motion="moderate", illumination=0.1, sunlit=200.0),
        replace(_SLOW, name="event_poster", world="poster", motion="moderate", motion_scale=0.8),
        replace(_SLOW, name="event_boxes", world="boxes", motion="aggressive"),
        *SUITE,
        *TWINS,
        *RESOLUTIONS,
    )
}
