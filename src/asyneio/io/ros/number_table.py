"""Numbers of many small messages of one topic as a table: inertial samples, poses."""

from __future__ import annotations

import numpy as np

from asyneio.io.ros.bag import Message
from asyneio.io.ros.field_offsets import Located, locate
from asyneio.io.ros.schema import Schema
from asyneio.types import NS_PER_S, FloatArray, IntArray

STAMP = "header.stamp"

_BATCH = 1000


class NumberTable:
    """Collects the stamp and some numbers of each message.

    Messages of one length differ in the values of numbers only, unless a text in them is split otherwise; so
    a batch is cut into columns at the places of its first message.

    Attributes:
        broken: count of messages that end early.
    """

    def __init__(self, schema: Schema, cdr: bool, names: tuple[str, ...]) -> None:
        self._schema, self._cdr, self._names = schema, cdr, names
        self._batch: list[bytes] = []
        self._batch_logged: list[int] = []
        self._parts: list[tuple[IntArray, IntArray, FloatArray]] = []
        self.broken = 0

    def add(self, message: Message) -> None:
        """Take a message."""
        data = bytes(message.data)
        if self._batch and (len(data) != len(self._batch[0]) or len(self._batch) == _BATCH):
            self._flush()
        self._batch.append(data)
        self._batch_logged.append(message.logged_ns)

    def columns(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Stamps [ns] (N,), when the messages were recorded [ns] (N,), and the numbers (N, names)."""
        self._flush()
        empty = (np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, len(self._names))))
        stamps, logged, values = zip(empty, *self._parts, strict=True)
        return np.concatenate(stamps), np.concatenate(logged), np.concatenate(values)

    def _flush(self) -> None:
        if not self._batch:
            return
        table = np.frombuffer(b"".join(self._batch), np.uint8).reshape(len(self._batch), -1)
        logged = np.array(self._batch_logged, dtype=np.int64)
        stamps = np.empty(len(table), dtype=np.int64)
        values = np.empty((len(table), len(self._names)))
        left = np.arange(len(table))
        kept = np.zeros(len(table), dtype=np.bool_)
        while left.size:
            first = self._batch[left[0]]
            try:
                located = locate(self._schema, first, self._cdr)
                same = left[_same_form(table[left], located, self._cdr)]
                stamps[same] = _stamps(table[same], located)
                for column, name in enumerate(self._names):
                    values[same, column] = _column(table[same], located, name)
                kept[same] = True
            except ValueError:
                same = left[:1]
                self.broken += 1
            left = np.setdiff1d(left, same, assume_unique=True)
        self._parts.append((stamps[kept], logged[kept], values[kept]))
        self._batch, self._batch_logged = [], []


def stamp_of(located: Located, data: bytes | memoryview) -> int:
    """The stamp in a message's header [ns]; 0 where it has none."""
    if f"{STAMP}.sec" not in located.places:
        return 0
    seconds = located.number(data, f"{STAMP}.sec")
    return seconds * NS_PER_S + located.number(data, f"{STAMP}.nanosec")


def _same_form(table: np.ndarray, located: Located, cdr: bool) -> np.ndarray:
    """Which rows of bytes have the length words of the first, and its order of bytes."""
    fixed = [offset + byte for offset in located.lengths for byte in range(4)] + ([0, 1] if cdr else [])
    return np.asarray((table[:, fixed] == table[0, fixed]).all(axis=1))


def _column(table: np.ndarray, located: Located, name: str) -> np.ndarray:
    place = located.place(name)
    if not place.count:
        raise ValueError(f"the field {name} is empty")
    width = int(place.dtype[1])
    content = np.ascontiguousarray(table[:, place.offset : place.offset + width])
    return content.view(located.order + place.dtype)[:, 0]


def _stamps(table: np.ndarray, located: Located) -> IntArray:
    seconds, rest = (
        _column(table, located, f"{STAMP}.{part}").astype(np.int64) for part in ("sec", "nanosec")
    )
    return seconds * NS_PER_S + rest
