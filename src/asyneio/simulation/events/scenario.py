"""What an event simulation simulates: one frozen record, and ready-made ones by name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.errors import SimulationError
from asyneio.simulation.events.sensor import SensorSpec
from asyneio.simulation.scenario import RigScenario

_DAVIS = SensorSpec()
#: A few lux: slow photoreceptors, much noise.
_DIM = SensorSpec(threshold_on=0.30, threshold_off=0.27, shot_noise_hz=5.0, hot_pixels=20, leak_hz=0.2)


@dataclass(frozen=True)
class EventScenario(RigScenario):
    """One simulated run of an event camera with an IMU.

    `world` names a `WorldKind`; `photographs`: textures are photographs instead of the built-in ones.
    `motion_scale` multiplies the positions of the motion (a small world needs small ones). A `motion_file`
    (see `load_motion`), from `motion_offset_s` on, replaces `motion`; it is never scaled. `illumination`:
    intensity of light, 1 in an office; `sunlit`: how many times brighter patches of sun are. The image moves
    at most `largest_step_px` between two renderings, which are at most `longest_step_s` apart.
    """

    name: str = "event_slow"
    motion: str = "gentle"
    motion_file: Path | None = None
    motion_offset_s: float = 0.0
    world: str = "room"
    photographs: bool = False
    motion_scale: float = 1.0
    sensor: SensorSpec = _DAVIS
    illumination: float = 1.0
    sunlit: float = 1.0
    largest_step_px: float = 0.7
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
        if self.motion_file is not None and self.motion_scale != 1.0:
            raise SimulationError(
                f"motion_scale = {self.motion_scale} with motion_file = {self.motion_file}; a recorded "
                "motion keeps its size: use motion_scale = 1 and a larger world, such as 'hall'"
            )


_SLOW = EventScenario()

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
    )
}
