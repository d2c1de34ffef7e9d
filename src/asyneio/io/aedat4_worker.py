"""Run as a script of its own: decodes an AEDAT4 file with the aedat package and writes frames to stdout.

The package is native code: damaged files make it panic, and some abort the whole process. Only a process
of its own is a wall that holds. It imports nothing of asyneio, so that it starts quickly.

A frame is a kind (one byte), a length (uint64, little-endian) and so many bytes:
`S` JSON of the streams, `E` events and `I` inertial samples as the package's records, each after the stream's
number (uint64); `X` the text of an error, `.` the end of a whole file.
"""

from __future__ import annotations

import json
import struct
import sys

import aedat
import numpy as np

FRAME = struct.Struct("<cQ")


def main(path: str) -> None:
    """Write all frames of one file."""
    out = sys.stdout.buffer

    def send(kind: bytes, *parts: bytes | memoryview) -> None:
        out.write(FRAME.pack(kind, sum(map(len, parts))))
        for part in parts:
            out.write(part)

    try:
        decoder = aedat.Decoder(path)
        send(b"S", json.dumps(decoder.id_to_stream()).encode())
        for packet in decoder:
            for kind, name in ((b"E", "events"), (b"I", "imus")):
                if name in packet:
                    # Its bytes as they are: another copy would cost as much as the decoding.
                    rows = np.ascontiguousarray(packet[name]).view(np.uint8)
                    send(kind, struct.pack("<Q", packet["stream_id"]), rows.data)
        send(b".")
    except BaseException as error:
        # A Rust panic is no Exception; whatever it is, the reader makes a sentence of it.
        send(b"X", " ".join(str(error).split())[:300].encode("utf-8", errors="replace"))


if __name__ == "__main__":
    main(sys.argv[1])
