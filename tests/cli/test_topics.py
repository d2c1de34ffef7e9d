"""Options that choose among several topics of a bag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Asyneio
from tests.io.event_recordings import make_event_recording
from tests.io.ros.bags import recording_records, write_bag


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "track"])
def test_the_error_names_the_option_and_the_option_helps(
    asyneio: Asyneio, tmp_path: Path, command: str
) -> None:
    records = recording_records(make_event_recording(np.random.default_rng(2), 500))
    more = [replace(record, topic=record.topic.replace("dvs", "right")) for record in records]
    path = write_bag(tmp_path / "two.bag", 1, records + more)
    output = ("--output", tmp_path / "out")
    status, _, error = asyneio(command, path, *output)
    assert status != 0
    assert "--events TOPIC" in " ".join(error.split())
    status, _, error = asyneio(command, path, *output, "--events", "/right/events")
    assert "--samples TOPIC" in " ".join(error.split())
    _, out, error = asyneio(command, path, *output, "--events", "/right/events", "--samples", "/right/imu")
    # Random data cannot be estimated, but they were read.
    told = " ".join((out + error).split())
    assert "events from /right/events" in told
    # Both parts have their poses in one topic, one after the other; events do not need them.
    assert "not used as ground truth: /optitrack/davis: time runs backwards" in told
