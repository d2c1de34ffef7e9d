"""True poses of a bag: a topic of poses, or the longest message of a path."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import drop_equal_stamps, sort_in_time
from asyneio.io.recording.sidecar import find_ground_truth
from asyneio.io.recording.tum import MAX_NORM_ERROR, POSE_DTYPE, poses_of
from asyneio.io.ros.bag import Topic
from asyneio.io.ros.field_offsets import each_item, locate
from asyneio.io.ros.number_table import stamp_of
from asyneio.io.ros.survey import PathTopic, Survey
from asyneio.io.ros.topic_choice import listed_topics
from asyneio.types import FloatArray, IntArray, PoseTrajectory

Notes = tuple[str, ...]

_NAMES = tuple(f"pose.position.{axis}" for axis in "xyz") + tuple(f"pose.orientation.{q}" for q in "xyzw")


def ground_truth_of_bag(found: Survey, folder: Path) -> tuple[PoseTrajectory | None, Notes]:
    """The poses of the only topic that has them, else of the only path, else of a file beside the bag."""
    for candidates in (list(found.poses), list(found.paths)):
        topics = [topic for topic in candidates if found.counts[topic]]
        if len(topics) > 1:
            return None, (f"several topics of poses, none taken as truth: {listed_topics(found, topics)}",)
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
            return None, (f"{name}: not taken as truth: {error}",)
    rows = np.empty(stamps.size, dtype=POSE_DTYPE)
    rows["t_ns"], rows["p"], rows["q"] = stamps, values[:, :3], values[:, 3:]
    good = np.asarray(np.isfinite(values).all(axis=1))
    good[good] = np.abs(np.linalg.norm(rows["q"][good], axis=1) - 1.0) < MAX_NORM_ERROR
    if not good.any():
        return None, (f"{name}: no pose is usable as truth",)
    if good.sum() > 1 and np.ptp(stamps[good]) == 0:
        return None, (f"{name}: not taken as truth: all poses have one stamp",)
    dropped = f"{name}: dropped {good.size - good.sum()} pose(s) that are none"
    try:
        rows, sorted_note = sort_in_time(rows[good], name)
    except RecordingError as error:
        return None, (f"not taken as truth: {error}",)
    rows, repeated_note = drop_equal_stamps(rows, name)
    notes = (f"the poses of {name} were taken as truth",) + (() if good.all() else (dropped,))
    return poses_of(rows), notes + sorted_note + repeated_note


def _path(path: PathTopic, cdr: bool) -> tuple[IntArray, FloatArray]:
    """Stamps [ns] (N,) and poses (N,7) of a path. Raises ValueError: the message ends early."""
    place = locate(path.schema, path.data, cdr).places["poses"]
    stamps = np.empty(place.count, dtype=np.int64)
    values = np.empty((place.count, len(_NAMES)))
    items = each_item(path.schema, place.kind, path.data, cdr, place.offset, place.count)
    for index, item in enumerate(items):
        stamps[index] = stamp_of(item, path.data)
        values[index] = [item.values(path.data, name)[0] for name in _NAMES]
    return stamps, values
