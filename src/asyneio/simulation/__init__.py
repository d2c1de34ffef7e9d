# SPDX-License-Identifier: Apache-2.0
"""Simulators of feature tracks and of events, with separate IMU streams and exact ground truth.

The package imports nothing from the estimator, so that it can be used to evaluate it.
"""

from asyneio.simulation.camera import PinholeCamera as PinholeCamera
from asyneio.simulation.events.point_truth import PointTruth as PointTruth
from asyneio.simulation.events.scenario import EVENT_SCENARIOS as EVENT_SCENARIOS
from asyneio.simulation.events.scenario import EventScenario as EventScenario
from asyneio.simulation.events.sensor import SensorSpec as SensorSpec
from asyneio.simulation.events.simulate import EventSimulation as EventSimulation
from asyneio.simulation.events.simulate import simulate_events as simulate_events
from asyneio.simulation.events.simulate import stream_events as stream_events
from asyneio.simulation.events.worlds import WorldKind as WorldKind
from asyneio.simulation.imu_errors import StreamErrors as StreamErrors
from asyneio.simulation.imu_sensors import IDEAL_IMU as IDEAL_IMU
from asyneio.simulation.imu_sensors import IMU_SENSORS as IMU_SENSORS
from asyneio.simulation.imu_sensors import ImuSensor as ImuSensor
from asyneio.simulation.imu_sensors import imu_named as imu_named
from asyneio.simulation.motion import AnalyticMotion as AnalyticMotion
from asyneio.simulation.motion import Sinusoids as Sinusoids
from asyneio.simulation.motion_styles import MotionStyle as MotionStyle
from asyneio.simulation.motion_styles import draw_motion as draw_motion
from asyneio.simulation.scene import SceneKind as SceneKind
from asyneio.simulation.tracks.observations import TrackSpec as TrackSpec
from asyneio.simulation.tracks.scenario import SCENARIOS as SCENARIOS
from asyneio.simulation.tracks.scenario import Scenario as Scenario
from asyneio.simulation.tracks.scenario import with_imu as with_imu
from asyneio.simulation.tracks.simulate import Simulation as Simulation
from asyneio.simulation.tracks.simulate import simulate as simulate
from asyneio.simulation.truth import StateTruth as StateTruth
from asyneio.simulation.truth import Truth as Truth
from asyneio.simulation.vibration import Vibration as Vibration
