# SPDX-License-Identifier: Apache-2.0
"""Ground truth of a bag: a topic of poses, or the longest message of a path."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import drop_equal_stamps, sort_in_time
from asyneio.io.recording.sidecar import find_ground_truth
from asyneio.io.recording.tum import MAX_NORM_ERROR, POSE_DTYPE, poses_of
from asyneio.io.ros.bag import Topic
from asyneio.io.ros.field_offsets import find_layout, item_layouts
from asyneio.io.ros.number_table import stamp_of
from asyneio.io.ros.survey import PathTopic, Survey
from asyneio.io.ros.topic_choice import listed_topics
from asyneio.types import FloatArray, IntArray, PoseTrajectory

Notes = tuple[str, ...]

_NAMES = tuple(f"pose.position.{axis}" for axis in "xyz") + tuple(f"pose.orientation.{q}" for q in "xyzw")


def ground_truth_of_bag(found: Survey, folder: Path) -> tuple[PoseTrajectory | None, Notes]:
    """Poses from the only topic of poses, else from the only path, else from a sidecar file."""
    for candidates in (list(found.poses), list(found.paths)):
        topics = [topic for topic in candidates if found.counts[topic]]
        if len(topics) > 1:
            return None, (
                f"several topics of poses, none used as ground truth: {listed_topics(found, topics)}",
            )
        if topics:
            return _of_topic(found, topics[0])
    return find_ground_truth(folder)


def _of_topic(found: Survey, topic: Topic) -> tuple[PoseTrajectory | None, Notes]:
    name = topic.name
    if topic in found.poses:
        stamps, _, values = found.poses[topic].columns()
    else:
        try:
            stamps, values = _path(found.paths[topic], topic.cdr)
        except ValueError as error:
            return None, (f"{name}: not used as ground truth: {error}",)
    rows = np.empty(stamps.size, dtype=POSE_DTYPE)
    rows["t_ns"], rows["p"], rows["q"] = stamps, values[:, :3], values[:, 3:]
    good = np.asarray(np.isfinite(values).all(axis=1))
    good[good] = np.abs(np.linalg.norm(rows["q"][good], axis=1) - 1.0) < MAX_NORM_ERROR
    if not good.any():
        return None, (f"{name}: no pose is usable as ground truth",)
    if good.sum() > 1 and np.ptp(stamps[good]) == 0:
        return None, (f"{name}: not used as ground truth: all poses have the same stamp",)
    dropped = f"{name}: dropped {good.size - good.sum()} invalid pose(s)"
    try:
        rows, sorted_note = sort_in_time(rows[good], name)
    except RecordingError as error:
        return None, (f"not used as ground truth: {error}",)
    rows, repeated_note = drop_equal_stamps(rows, name)
    notes = (f"ground truth from the poses of {name}",) + (() if good.all() else (dropped,))
    return poses_of(rows), notes + sorted_note + repeated_note


def _path(path: PathTopic, cdr: bool) -> tuple[IntArray, FloatArray]:
    """Stamps [ns] (N,) and poses (N,7) of a path. Raises ValueError: the message is too short."""
    field = find_layout(path.schema, path.data, cdr).fields["poses"]
    stamps = np.empty(field.count, dtype=np.int64)
    values = np.empty((field.count, len(_NAMES)))
    items = item_layouts(path.schema, field.kind, path.data, cdr, field.offset, field.count)
    for index, item in enumerate(items):
        stamps[index] = stamp_of(item, path.data)
        values[index] = [item.values(path.data, name)[0] for name in _NAMES]
    return stamps, values
