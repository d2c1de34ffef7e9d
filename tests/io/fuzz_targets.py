"""Everything that reads foreign bytes, each as a function of one input, with inputs to start from.

`benchmarks/fuzz.py` feeds them with a million inputs, `test_fuzz.py` with the committed corpus.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asyneio.config import dump_config, load_config
from asyneio.errors import AsyneioError
from asyneio.io import open_recording, read_inertial_file, read_trajectory
from asyneio.io.aedat.aedat2 import Aedat2Events
from asyneio.io.aedat.aedat4 import Aedat4Events
from asyneio.io.calibration import read_calibration
from asyneio.io.event_stream import EventStreamEvents
from asyneio.io.hdf5.asyneio_reader import MAGIC as HDF5_MAGIC
from asyneio.io.prophesee.dat import DatDecoder
from asyneio.io.prophesee.evt2 import Evt2Decoder
from asyneio.io.prophesee.evt3 import Evt3Decoder
from asyneio.io.prophesee.evt21 import Evt21Decoder
from asyneio.io.prophesee.header import read_header
from asyneio.io.prophesee.reader import Decoder
from asyneio.io.recording.event_source import SAMPLE_DTYPE, EventSource
from asyneio.io.results.estimates import read_estimates, write_estimates
from asyneio.io.ros.bag import Bag
from asyneio.io.ros.event_packets import ENCODINGS, Packet, PacketDecoder
from asyneio.io.ros.mcap import McapFile
from asyneio.io.ros.rosbag1 import Rosbag1
from asyneio.io.text.reader import TextEvents
from asyneio.types import EVENT_DTYPE, EventRecording, Recording
from tests.io.recordings import make_estimate
from tests.io.small_files import FILES, TEXTS
from tests.io.validity import (
    assert_valid,
    assert_valid_calibration,
    assert_valid_samples,
    assert_valid_trajectory,
)

#: Larger files cost time for each input and reach no other code.
_MAX_SEED_BYTES = 2**18
#: What differs between messages of one kind: numbers, and texts from the input.
_VARIABLE = re.compile(r"'[^']*'|\"[^\"]*\"|[-+]?[0-9][0-9.e+-]*")


@dataclass(frozen=True)
class Target:
    """A reader of bytes.

    `read` returns the kind of outcome: a text in which numbers and quotations are removed. Inputs with a new
    kind are worth keeping. It raises AssertionError for an invalid result; any exception is a defect.
    `weight`: relative number of inputs, more for fast decoders, fewer for what the HDF5 library reads.
    """

    name: str
    read: Callable[[bytes], str]
    seeds: tuple[bytes, ...]
    weight: float = 1.0


def make_targets(folder: Path) -> dict[str, Target]:
    """All targets by name; inputs are written into the empty `folder`."""
    (folder / "seeds").mkdir()
    (folder / "one").mkdir()
    path = folder / "one" / "input"
    seeds = folder / "seeds"
    found = [
        *_recordings(seeds, path),
        *_other_files(seeds, path),
        *_decoders(seeds, path),
        _packets(),
    ]
    return {target.name: target for target in found}


def _recordings(folder: Path, path: Path) -> list[Target]:
    """The formats of recordings, through `open_recording`."""
    read = _of_file(path, open_recording, _checked_notes)
    found = []
    for name, (make, _) in FILES.items():
        seed = make(folder / name.replace(" ", "-")).read_bytes()
        if len(seed) < _MAX_SEED_BYTES:
            found.append(Target(name, read, (seed,), 0.2 if seed.startswith(HDF5_MAGIC) else 1.0))
    return found


def _checked_notes(found: Recording | EventRecording) -> tuple[str, ...]:
    assert_valid(found)
    return found.notes


def _other_files(folder: Path, path: Path) -> list[Target]:
    """Calibrations, samples, trajectories, settings and results."""
    estimates = folder / "estimates.npz"
    write_estimates(estimates, [make_estimate(t, np.random.default_rng(1)) for t in (0, 10**8)])
    seeds = {name: tuple(text.encode() for text in texts) for name, texts in TEXTS.items()}
    readers: dict[str, tuple[Callable[[Path], object], Callable[..., object]]] = {
        "calibration": (lambda p: read_calibration(p, size=(240, 180))[0], assert_valid_calibration),
        "inertial": (read_inertial_file, assert_valid_samples),
        "trajectory": (lambda p: read_trajectory(p)[0], assert_valid_trajectory),
        "settings": (load_config, dump_config),
        "estimates": (read_estimates, list),
    }
    seeds["settings"] = (dump_config(load_config(None)).encode(), b"window: {length_s: 2}\n")
    seeds["estimates"] = (estimates.read_bytes(),)
    return [
        Target(name, _of_file(path, read, check), seeds[name], 2.0) for name, (read, check) in readers.items()
    ]


def _decoders(folder: Path, path: Path) -> list[Target]:
    """The decoders of the own formats alone, without the search for sidecar files: ten times as fast."""
    sources: dict[str, Callable[[Path], EventSource]] = {
        "aedat2": Aedat2Events,
        "aedat4": Aedat4Events,
        "text": TextEvents,
        "csv": TextEvents,
        "event stream": lambda p: EventStreamEvents(p, atis=False),
        "event stream, ATIS": lambda p: EventStreamEvents(p, atis=True),
    }
    bags: dict[str, Callable[[Path], Bag]] = {"bag": Rosbag1, "mcap": McapFile}
    words: dict[str, tuple[Callable[[], Decoder], str]] = {
        "evt2": (Evt2Decoder, "<u4"),
        "evt2.1": (Evt21Decoder, "<u8"),
        "evt3": (Evt3Decoder, "<u2"),
        "dat": (DatDecoder, "<u4"),
    }
    made = {name: FILES[name][0](folder / f"{name}-alone").read_bytes() for name in (*sources, *bags, *words)}
    reads = {
        **{name: _of_file(path, _source_reader(source), tuple) for name, source in sources.items()},
        **{name: _of_file(path, _bag_reader(bag), tuple) for name, bag in bags.items()},
        **{name: _word_reader(*decoder) for name, decoder in words.items()},
    }
    for name in words:
        start = read_header(folder / f"{name}-alone").data_start
        made[name] = made[name][start + 2 * (name == "dat") :]
    return [Target(f"{name} decoder", read, (made[name],), weight=5.0) for name, read in reads.items()]


def _source_reader(make: Callable[[Path], EventSource]) -> Callable[[Path], tuple[str, ...]]:
    def read(path: Path) -> tuple[str, ...]:
        source = make(path)
        for events, fraction in source.chunks():
            assert events.dtype == EVENT_DTYPE
            assert 0.0 <= fraction <= 1.0
        assert source.samples().dtype == SAMPLE_DTYPE
        return source.notes()

    return read


def _bag_reader(make: Callable[[Path], Bag]) -> Callable[[Path], tuple[str, ...]]:
    def read(path: Path) -> tuple[str, ...]:
        notes: list[str] = []
        bag = make(path)
        for message, fraction in bag.messages(notes):
            assert -(2**63) <= message.logged_ns < 2**63
            assert 0.0 <= fraction <= 1.0
        assert all(topic.name is not None for topic in bag.topics())
        return tuple(notes)

    return read


def _word_reader(make: Callable[[], Decoder], word: str) -> Callable[[bytes], str]:
    """Words in two pieces; the last byte says where the first one ends."""

    def read(data: bytes) -> str:
        decoder, dtype = make(), np.dtype(word)
        words = np.frombuffer(data, dtype, len(data) // dtype.itemsize)
        # Records of DAT have two words.
        cut = 2 * int(data[-1] % (words.size // 2 + 1)) if data else 0
        try:
            pieces = [decoder.feed(words[:cut]), decoder.feed(words[cut : words.size // 2 * 2], last=True)]
        except AsyneioError as error:
            return _kind((str(error),))
        for events in pieces:
            assert events.dtype == EVENT_DTYPE
            assert not events.size or events["p"].max() <= 1
        return _kind(decoder.notes("words"))

    return read


def _packets() -> Target:
    """The encodings of event_camera_msgs: the first byte selects one, the second cuts the data in two."""

    def read(data: bytes) -> str:
        if len(data) < 2:
            return "short"
        encoding = ENCODINGS[data[0] % len(ENCODINGS)]
        decoder, content = PacketDecoder(), np.frombuffer(data, np.uint8)[2:]
        cut = data[1] % (content.size + 1)
        pieces = [
            decoder.decode(Packet(encoding, piece, 10**9, seq, seq * 10**6))
            for seq, piece in ((0, content[:cut]), (1, content[cut:]))
        ]
        for events in (*pieces, decoder.flush(), decoder.finish()):
            assert events.dtype == EVENT_DTYPE
            assert not events.size or events["p"].max() <= 1
        return f"{encoding} {_kind(decoder.notes('packets'))}"

    words = np.random.default_rng(1).bytes(96)
    return Target(
        "event packets", read, tuple(bytes([k, 40]) + words for k in range(len(ENCODINGS))), weight=5.0
    )


def _of_file(
    path: Path, read: Callable[[Path], object], check: Callable[..., object]
) -> Callable[[bytes], str]:
    """Write the input to `path` and read it: valid, or an error of ours with a message."""

    def one(data: bytes) -> str:
        path.write_bytes(data)
        try:
            found = read(path)
        except AsyneioError as error:
            message = str(error)
            assert message
            return _kind((message,))
        notes = check(found)
        return _kind(notes) if isinstance(notes, tuple) else "read"

    return one


def _kind(texts: Sequence[str]) -> str:
    """The texts without what differs between messages of one kind."""
    return "; ".join(sorted({_VARIABLE.sub("", text)[:120] for text in texts})) or "read"
