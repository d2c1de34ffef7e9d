"""Random bytes and damaged files in every format: a valid recording, or an error with a message.

A reader may keep what stands before the damage, reject the file, or read a changed value. Everything that it
returns is in order, inside the sensor and finite.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from asyneio.io import open_recording, read_inertial_file, read_trajectory
from asyneio.io import write_tracks_folder as write_tracks
from fuzz import corpus_of
from tests.io.fuzz_targets import Target, make_targets
from tests.io.prophesee.files import DAT, NEW, OLD
from tests.io.recordings import START_NS, make_recording
from tests.io.small_files import FILES
from tests.io.validity import (
    assert_valid,
    assert_valid_samples,
    assert_valid_trajectory,
    valid_or_rejected,
)

#: Beginnings of files by which formats are recognised.
HEADS = {
    "nothing": b"",
    "aedat2": b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n",
    "aedat4": b"#!AER-DAT4.0\r\n",
    "hdf5": b"\x89HDF\r\n\x1a\n",
    "evt2": NEW,
    "evt2, old": OLD,
    "evt2.1": b"% evt 2.1\n% geometry 240x180\n% end\n",
    "evt3": b"% evt 3.0\n% geometry 64x48\n% end\n",
    "prophesee": b"% ",
    "dat header": DAT,
    "dat": DAT + b"\x0c\x08",
    "event stream": b"Event Stream\2\0\0\1\xf0\0\xb4\0",
    "numpy": b"\x93NUMPY\1\0",
    "gzip": b"\x1f\x8b\x08",
    "bag": b"#ROSBAG V2.0\n",
    "mcap": b"\x89MCAP0\r\n",
    "text": b"1.0 2 3 1\n",
    "named text": b"t,x,y,p\n1,2,3,1\n",
}


_FUNCTION_FIXTURES = [HealthCheck.function_scoped_fixture]


@pytest.mark.slow
@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS.keys())
@given(data=st.binary(max_size=400))
@settings(max_examples=40, suppress_health_check=_FUNCTION_FIXTURES)
def test_random_bytes(tmp_path: Path, head: bytes, data: bytes) -> None:
    path = tmp_path / "recording"
    path.write_bytes(head + data)
    valid_or_rejected(lambda: open_recording(path), assert_valid)


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return make_targets(tmp_path_factory.mktemp("targets"))


@pytest.mark.slow
def test_corpus(targets: dict[str, Target]) -> None:
    """Inputs that once led to a new kind of outcome: none ends in anything but an error of asyneio."""
    inputs = {name: corpus_of(name) for name in targets}
    assert sum(map(len, inputs.values())) > 60
    for name, contents in inputs.items():
        for content in contents:
            targets[name].read(content)


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], bytes]:
    """The bytes of a valid file of a format, made once."""
    made: dict[str, bytes] = {}

    def content(kind: str) -> bytes:
        if kind not in made:
            path = FILES[kind][0](tmp_path_factory.mktemp("intact") / "whole")
            assert_valid(open_recording(path))
            made[kind] = path.read_bytes()
        return made[kind]

    return content


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
@given(
    changes=st.lists(st.tuples(st.integers(0, 10**6), st.binary(min_size=1, max_size=6)), max_size=4),
    keep=st.one_of(st.none(), st.integers(0, 10**6)),
)
@settings(max_examples=40, suppress_health_check=_FUNCTION_FIXTURES)
def test_damaged_files(
    tmp_path: Path,
    intact: Callable[[str], bytes],
    kind: str,
    changes: list[tuple[int, bytes]],
    keep: int | None,
) -> None:
    """Bytes changed anywhere, and possibly the end cut off."""
    whole, fixed = intact(kind), FILES[kind][1]
    data = bytearray(whole)
    for position, value in changes:
        start = fixed + position % (len(whole) - fixed)
        data[start : start + len(value)] = value
    path = tmp_path / "damaged"
    path.write_bytes(data if keep is None else data[: fixed + keep % (len(whole) - fixed)])
    valid_or_rejected(lambda: open_recording(path), assert_valid)


@pytest.mark.slow
@given(
    text=st.text(alphabet="0123456789.eE+-, \t\n#tgaxyzw_[]nsui\0", max_size=300), valid_start=st.booleans()
)
@settings(max_examples=200, suppress_health_check=_FUNCTION_FIXTURES)
def test_random_tables(tmp_path: Path, text: str, valid_start: bool) -> None:
    """Text as inertial samples and as a trajectory."""
    path = tmp_path / "table.txt"
    path.write_text(("1.0 0 0 0 0 0 0 1\n" if valid_start else "") + text)
    valid_or_rejected(lambda: read_inertial_file(path), assert_valid_samples)
    valid_or_rejected(lambda: read_trajectory(path)[0], assert_valid_trajectory)


_LINES = st.one_of(
    st.text(max_size=40),
    st.lists(
        st.sampled_from(["nan", "inf", "-1", "1e400", "0x10", "1_0", "#", "9" * 25, "", '"', str(START_NS)]),
        max_size=7,
    ).map(",".join),
)


@pytest.mark.slow
@given(lines=st.lists(_LINES, max_size=30), name=st.sampled_from(["tracks.csv", "imu.csv"]), data=st.data())
def test_tracks_folders(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str], name: str, data: st.DataObject
) -> None:
    """Random lines between those of a tracks folder."""
    folder = tmp_path_factory.mktemp("fuzz")
    write_tracks(make_recording(np.random.default_rng(1), seconds=0.3, tracks=3), folder)
    text = (folder / name).read_text().splitlines()
    for line in lines:
        text.insert(data.draw(st.integers(0, len(text))), line)
    (folder / name).write_text("\n".join(text), encoding="utf-8", errors="replace")
    valid_or_rejected(lambda: open_recording(folder), assert_valid)
