# SPDX-License-Identifier: Apache-2.0
"""Event scenarios: the parameters of a simulated run, and predefined scenarios by name."""

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
#: A few lux: slow photoreceptors and much noise.
_DIM = SensorSpec(threshold_on=0.30, threshold_off=0.27, shot_noise_hz=5.0, hot_pixels=20, leak_hz=0.2)


class Person(StrEnum):
    """Motion of a box of a person's size in front of the camera, if there is one."""

    NOBODY = "nobody"
    STANDING = "standing"
    WALKING = "walking"


@dataclass(frozen=True)
class EventScenario(RigScenario):
    """One simulated run of an event camera with an IMU.

    Attributes:
        world: a value of `WorldKind`.
        photographs: use photographs as textures instead of procedural ones.
        motion_scale: factor on the positions of the motion; small worlds need a small one.
        recorded: recorded run that replaces motion and IMU (see `along`); it is not scaled.
        illumination: intensity of the light; 1 is an office.
        sunlit: ratio of the brightness of sunlit patches to shade.
        flicker_depth: fraction of the light that comes from flickering lamps; it does not change the mean.
        flicker_hz: frequency of the rectified sine of the lamps, twice the mains frequency [Hz].
        largest_step_px: maximum image motion between two renderings [px].
        longest_step_s: maximum time between two renderings [s].
        person: a value of `Person`; motion and world do not depend on it.
        person_spot_m: mean position of the person in the world [m].
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
                f"flicker_depth = {self.flicker_depth} at flicker_hz = {self.flicker_hz}; expected a depth "
                "of 0 to 1 and a frequency up to 1000 Hz"
            )
        if self.person not in list(Person):
            raise SimulationError(f"person {self.person!r} is unknown; expected one of {', '.join(Person)}")
        if self.recorded is not None and self.motion_scale != 1.0:
            raise SimulationError(
                f"motion_scale = {self.motion_scale} with a recorded motion, which cannot be scaled: use "
                "motion_scale = 1 and a larger world, such as 'around'"
            )

    def along(self, recorded: RecordedRun, noise: ImuNoise) -> EventScenario:
        """This scenario along a recorded path, in a room around it, with the IMU samples recorded on it.

        Args:
            recorded: motion and samples.
            noise: noise of that IMU.
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
    """Rate of a stream [Hz], from the median of its steps."""
    return NS_PER_S / float(np.median(np.diff(t_ns)))


_SLOW = EventScenario()

#: Base of the scenarios of the suite: their duration and the IMU of that camera.
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


#: Sequences like those of the DAVIS240C data set (Mueggler et al. 2017), with its camera, clock and IMU.
#: Each has its own seed, so that their motions differ.
SUITE: tuple[EventScenario, ...] = (
    _suite(0, "boxes_6dof", "boxes", "six_dof", 1.0),
    _suite(1, "boxes_translation", "boxes", "translation", 1.0),
    _suite(2, "hdr_boxes", "boxes", "six_dof", 1.0, **_HDR),
    _suite(3, "poster_6dof", "poster", "six_dof", 0.85),
    _suite(4, "poster_translation", "poster", "translation", 0.85),
    _suite(5, "hdr_poster", "poster", "six_dof", 0.85, **_HDR),
    replace(_suite(6, "dynamic_6dof", "room", "six_dof", 0.55), person="walking"),
    # More distant, because without rotation of the camera the person causes most of the events.
    replace(
        _suite(7, "dynamic_translation", "room", "translation", 0.55),
        person="walking",
        person_spot_m=(1.7, 0.0, -0.5),
    ),
    replace(_suite(8, "low_light", "room", "six_dof", 1.0, illumination=0.03), sensor=_DIM),
)

#: The dynamic ones without a person, and with a standing person, to measure the effect of walking.
TWINS: tuple[EventScenario, ...] = tuple(
    replace(scenario, name=f"{scenario.name}_{person}", person=person)
    for scenario in SUITE
    if scenario.person != Person.NOBODY
    for person in (Person.NOBODY, Person.STANDING)
)


def at_resolution(scenario: EventScenario, width: int, height: int) -> EventScenario:
    """The same run with another sensor behind the same lens.

    The horizontal field of view and the shape of the pixels are unchanged; a wider aspect ratio loses rows at
    top and bottom.

    Args:
        scenario: scenario with any sensor.
        width, height: size of the new sensor [px].
    """
    old = scenario.camera
    scale = width / old.width
    # Pixel centres are half a pixel inside the border of the image, which stays at the same position.
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


#: The boxes of the suite with finer textures, also at the resolutions of current sensors.
_FINE = _suite(0, "fine_6dof", "fine", "six_dof", 1.0)
RESOLUTIONS: tuple[EventScenario, ...] = (
    _FINE,
    at_resolution(_FINE, 640, 480),
    at_resolution(_FINE, 1280, 720),
)

#: Predefined event scenarios by name; change them with `dataclasses.replace`.
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
