"""Event files and folders: kinds A, B, E (events), M (files) and N."""

from __future__ import annotations

from case_expectations.step import Expectations, Step

_READ = (r"\d{5} events", r"0 FAIL")
#: Advice that is wrong for a file whose columns are read.
_GUESSES = (r"record again", r"several streams", r"split the file")
#: Events and samples are read and overlap; initialization needs more than the 1.2 s of these recordings.
_TOO_SHORT = Step(
    "asyneio run data -o out",
    status=(0, 1),
    says=(r"recording . 1\.10 s", r"events . 0\.09 million", r"trajectory"),
    silent=(r"expected",),
    files=("out/health.csv", "out/attitude.csv"),
)

CASES: Expectations = {
    "R03": (
        Step(
            "asyneio doctor data",
            status=(1,),
            says=(r"not usable", r"rec\.raw", r"EVT 2\.1|before the first time"),
        ),
    ),
    "E07": (
        Step("asyneio doctor data", says=(*_READ, r"columns t x y p \(by their names\)", r"microseconds")),
        Step("asyneio track data/events.csv -o out", files=("out/*",)),
    ),
    "E09": (
        Step("asyneio doctor data", says=(*_READ, r"events\.txt\.gz")),
        _TOO_SHORT,
    ),
    "H01": (
        Step(
            "asyneio doctor data",
            status=(1,),
            says=(r"events\.h5", r"columns t x y p", r"not overlap|clocks"),
        ),
        Step(
            "asyneio track data/events.h5 -o out",
            says=(r"columns t x y p", r"inertial samples are not used: .*overlap.* s apart"),
            files=("out/tracks.csv",),
        ),
    ),
    "H02": (
        Step("asyneio doctor data", status=(1,), says=(r"rec\.h5", r"ts xs ys ps", r"clocks")),
        Step(
            "asyneio track data/rec.h5 -o out",
            says=(r"columns ts xs ys ps", r"inertial samples are not used: .*overlap.* s apart"),
            files=("out/tracks.csv",),
        ),
    ),
    "I30": (
        Step(
            "asyneio doctor data",
            says=(
                *_READ,
                r"imu\.csv \(inertial samples\)",
                r"imu\.csv: gyroscope first",
                r"1200 samples of the gyroscope",
            ),
        ),
        _TOO_SHORT,
    ),
    "E01a": (
        Step("asyneio track data/events.csv -o out", says=(r"x y p t", r"microseconds"), files=("out/*",)),
    ),
    "E02": (
        Step("asyneio doctor data", says=(*_READ, r"columns x y p t, time in microseconds"), silent=_GUESSES),
    ),
    "E04": (
        Step(
            "asyneio track data -o out",
            status=(1,),
            says=(r"not sorted by time", r"sort -s -g events\.txt"),
        ),
        Step(
            "cd data && sort -s -g events.txt > sorted.txt && mv sorted.txt events.txt && asyneio doctor .",
            says=(*_READ, r"event order: ascending"),
            own=True,
        ),
    ),
    "E06": (Step("asyneio doctor data", says=(*_READ, r"time in microseconds"), silent=_GUESSES),),
    "E13": (Step("asyneio doctor data", says=(*_READ, r"time in nanoseconds"), silent=_GUESSES),),
    "H05": (
        Step("asyneio doctor data", says=(*_READ, r"nanoseconds \(stamps since 1970\)"), silent=_GUESSES),
    ),
    "E08": (
        Step(
            "asyneio doctor data",
            status=(1,),
            says=(r"decimal commas", r"'1600000000,\d+;\d+;\d+;[01]'", r"sed -i"),
            silent=(r"record again",),
        ),
        Step("cd data && sed -i 's/,/./g; s/;/ /g' events.txt && asyneio doctor .", says=_READ, own=True),
    ),
    "H03": (
        Step("asyneio track data -o out", says=(r"time in seconds",), files=("out/*",)),
        Step("asyneio doctor data", says=(*_READ, r"time in seconds"), silent=(r"kind 'iu'",)),
    ),
    "H08": (
        Step("asyneio track data -o out", files=("out/*",)),
        Step("asyneio doctor data", says=(*_READ, r"microseconds"), silent=(r"kind 'iu'",)),
    ),
    "E18": (
        Step("asyneio track data -o out", says=(r"dropped 1 isolated event",), files=("out/*",)),
        Step("asyneio doctor data", says=(*_READ, r"dropped 1 isolated event"), silent=(r"factor 1000000",)),
    ),
    "P04": (
        Step(
            "python -c \"from asyneio.io import open_recording; print(open_recording('data').name)\"",
            says=(r"^data$",),
        ),
    ),
    "E07b": (Step("asyneio doctor data", says=_READ, silent=(r"unreadable", r"skipped")),),
}
