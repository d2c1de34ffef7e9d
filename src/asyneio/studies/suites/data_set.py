# SPDX-License-Identifier: Apache-2.0
"""What a preset knows about a data set: files, calibration, ground truth, protocols, published results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from asyneio.studies.suites.published import Measure, Published
from asyneio.types import Calibration, FloatArray


class TruthFrame(StrEnum):
    """Whose poses the ground truth contains, in whose clock.

    BODY: the IMU, in its clock. CAMERA: the event camera, in its clock. MARKERS: the markers of the motion
    capture, in the clock of the IMU.
    """

    BODY = "body"
    CAMERA = "camera"
    MARKERS = "markers"


@dataclass(frozen=True)
class Location:
    """Where a recording is, as a path relative to the folder of the data set; `{name}` is the sequence.

    `content`: the file that has to exist, and whose size and modification time identify the recording; empty:
    `source` itself.
    """

    source: str
    content: str = ""


@dataclass(frozen=True)
class PerSequence:
    """File names that depend on the sequence: `usual`, except for those in `special`."""

    usual: tuple[str, ...] = ()
    special: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def of(self, sequence: str) -> tuple[str, ...]:
        """The names for a sequence, `{name}` replaced."""
        return tuple(name.format(name=sequence) for name in self.special.get(sequence, self.usual))


#: From the files of a data set and the calibration to `T_b_m` (4,4), markers to body.
MarkerPose = Callable[[Sequence[Path], Calibration], FloatArray]


@dataclass(frozen=True)
class DataSet:
    """A data set as a preset of `asyneio bench`.

    Attributes:
        name: of the command.
        title: for the report.
        sequences: those that are run by default, in the order of the tables.
        locations: where a recording may be, in order of preference.
        calibration: files with camera and extrinsics, in order of preference, relative to the folder of the
            recording or the folders above it; empty: the recording's own, or the option --calibration.
        imu: the same for the noise of the IMU.
        truth: the same for the ground truth; empty: the recording contains it, or has it in a sidecar file.
        samples: the same for the inertial samples; empty: as for `truth`.
        events: the camera of a stereo pair, or the topic.
        inertial: the topic of the inertial samples.
        camera: the camera in the calibration file.
        preset: camera model whose published values fill gaps in the calibration.
        frame: of the ground truth.
        markers: files for `marker_pose`, relative as above.
        marker_pose: pose of the markers in the body, if `frame` is MARKERS.
        max_gap_s: ground truth is not interpolated across longer gaps.
        protocols: of the comparison; the first one is required.
        measure: the figure of the comparison.
        published: results of others.
        sources: where these facts are from.
        remark: what a user must know.
    """

    name: str
    title: str
    sequences: tuple[str, ...]
    locations: tuple[Location, ...]
    calibration: PerSequence = PerSequence()
    imu: PerSequence = PerSequence()
    truth: PerSequence = PerSequence()
    samples: PerSequence = PerSequence()
    events: str | None = None
    inertial: str | None = None
    camera: str | None = None
    preset: str | None = None
    frame: TruthFrame = TruthFrame.BODY
    markers: PerSequence = PerSequence()
    marker_pose: MarkerPose | None = None
    max_gap_s: float = 0.05
    protocols: tuple[str, ...] = ("posyaw", "se3")
    measure: Measure = Measure.ATE
    published: tuple[Published, ...] = ()
    sources: tuple[str, ...] = ()
    remark: str = ""

    @property
    def simulated(self) -> bool:
        """True if the recordings are simulated: there are no files."""
        return not self.locations
