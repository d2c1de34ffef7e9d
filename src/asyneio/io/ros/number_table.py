# SPDX-License-Identifier: Apache-2.0
"""Numbers of many small messages of one topic as a table: inertial samples, poses."""

from __future__ import annotations

import numpy as np

from asyneio.io.ros.bag import Message
from asyneio.io.ros.field_offsets import MessageLayout, find_layout
from asyneio.io.ros.schema import Schema
from asyneio.types import NS_PER_S, FloatArray, IntArray

STAMP = "header.stamp"

_BATCH = 1000


class NumberTable:
    """Collects the stamp and selected numbers of each message.

    Messages of equal length have the same layout, unless their texts differ in length; so a batch is cut into
    columns by the layout of its first message.

    Attributes:
        broken: number of messages that are too short.
    """

    def __init__(self, schema: Schema, cdr: bool, names: tuple[str, ...]) -> None:
        self._schema, self._cdr, self._names = schema, cdr, names
        self._batch: list[bytes] = []
        self._batch_logged: list[int] = []
        self._parts: list[tuple[IntArray, IntArray, FloatArray]] = []
        self.broken = 0

    def add(self, message: Message) -> None:
        """Add a message."""
        data = bytes(message.data)
        if self._batch and (len(data) != len(self._batch[0]) or len(self._batch) == _BATCH):
            self._flush()
        self._batch.append(data)
        self._batch_logged.append(message.logged_ns)

    def columns(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Stamps [ns] (N,), recording times [ns] (N,), and the numbers (N, names)."""
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
                layout = find_layout(self._schema, first, self._cdr)
                same = left[_same_form(table[left], layout, self._cdr)]
                stamps[same] = _stamps(table[same], layout)
                for column, name in enumerate(self._names):
                    values[same, column] = _column(table[same], layout, name)
                kept[same] = True
            except ValueError:
                same = left[:1]
                self.broken += 1
            left = np.setdiff1d(left, same, assume_unique=True)
        self._parts.append((stamps[kept], logged[kept], values[kept]))
        self._batch, self._batch_logged = [], []


def stamp_of(layout: MessageLayout, data: bytes | memoryview) -> int:
    """The stamp in the header of a message [ns]; 0 if it has none."""
    if f"{STAMP}.sec" not in layout.fields:
        return 0
    seconds = layout.number(data, f"{STAMP}.sec")
    return seconds * NS_PER_S + layout.number(data, f"{STAMP}.nanosec")


def _same_form(table: np.ndarray, layout: MessageLayout, cdr: bool) -> np.ndarray:
    """Which rows of bytes have the length words and the byte order of the first row."""
    fixed = [offset + byte for offset in layout.lengths for byte in range(4)] + ([0, 1] if cdr else [])
    return np.asarray((table[:, fixed] == table[0, fixed]).all(axis=1))


def _column(table: np.ndarray, layout: MessageLayout, name: str) -> np.ndarray:
    field = layout.field(name)
    if not field.count:
        raise ValueError(f"the field {name} is empty")
    width = int(field.dtype[1])
    content = np.ascontiguousarray(table[:, field.offset : field.offset + width])
    return content.view(layout.order + field.dtype)[:, 0]


def _stamps(table: np.ndarray, layout: MessageLayout) -> IntArray:
    seconds, rest = (
        _column(table, layout, f"{STAMP}.{part}").astype(np.int64) for part in ("sec", "nanosec")
    )
    return seconds * NS_PER_S + rest
