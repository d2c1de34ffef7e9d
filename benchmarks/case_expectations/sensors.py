"""Sensors and surroundings: kinds C, D, E (IMU), L and M (arrays)."""

from __future__ import annotations

from case_expectations.step import Expectations, Step

_INTERRUPT = (
    'python3 -c "import subprocess,signal,time; p=subprocess.Popen'
    "(['asyneio','run','data','-o','out'],preexec_fn=lambda: signal.signal(signal.SIGINT,"
    'signal.default_int_handler)); time.sleep(8); p.send_signal(2); print(p.wait())"; ls out'
)
_NO_DEFECT = (r"defect of asyneio", r"Traceback")

CASES: Expectations = {
    "GY125": (
        Step(
            "asyneio doctor data", status=(1,), says=(r"FAIL +imu scale: the gyroscope reads 0\.12\d? times",)
        ),
        Step(
            "asyneio run data -o out",
            status=(1,),
            says=(r"0\.12\d? times the rotation of gravity",),
            own=True,
        ),
    ),
    "GY2": (
        Step(
            "asyneio doctor data",
            status=(1,),
            says=(r"FAIL +imu scale: the gyroscope reads (1\.9\d|2\.0\d) times", r"which gravity confirms"),
        ),
        Step("asyneio run data -o out", status=(1,), says=(r"times the rotation of gravity",), own=True),
    ),
    "S05": (
        Step("asyneio doctor data", status=(1,), says=(r"FAIL +imu units", r"full-scale range")),
        Step(
            "asyneio run data -o out",
            status=(1,),
            says=(r"reads gravity as (4\.9|5\.0)",),
            absent=("out/trajectory.tum",),
        ),
    ),
    "CLK025": (Step("asyneio doctor data", status=(1,), says=(r"FAIL +time offset", r"-2(49|50)\.\d ms")),),
    "C06": (
        Step("asyneio doctor data", says=(r"WARNING +message stamps", r"advance by 0\.2 s", r"replay\?")),
    ),
    "I16b": (
        Step(
            "timeout 60 asyneio doctor data",
            says=(r"NOTE +imu order: .*1 sample\(s\) with an isolated wrong timestamp",),
        ),
        Step(
            "asyneio run data -o out",
            status=(0, 1),
            says=(r"dropped 1 row\(s\) with an isolated wrong time stamp",),
            silent=(r"in seconds\?", r"backwards"),
        ),
    ),
    "I16c": (
        Step(
            "asyneio run data -o out",
            status=(0, 1),
            says=(r"dropped 1 row\(s\) with an isolated wrong time stamp",),
            silent=(r"split the file", r"backwards"),
        ),
        Step(
            "asyneio doctor data",
            says=(r"NOTE +imu order: .*1 sample\(s\) with an isolated wrong timestamp",),
            silent=(r"split the recording",),
        ),
    ),
    "X06h": (
        Step(
            "mkdir -p tiny; mount -t tmpfs -o size=300k tmpfs tiny; asyneio convert data tiny/o.h5; "
            "echo rc=$?; umount tiny",
            says=(r"No space left on device; check", r"rc=1\b"),
            silent=_NO_DEFECT,
            root=True,
        ),
    ),
    "X07": (
        Step(
            r'cp -r data "$(printf "old\xff\xfename")"; asyneio run "$(printf "old\xff\xfename")" -o out; '
            "echo rc=$?; ls out",
            says=(r"rc=0\b",),
            silent=_NO_DEFECT,
            files=("out/report.html", "out/trajectory.tum"),
        ),
    ),
    "X09b": (
        Step(
            "MPLBACKEND=module://matplotlib_inline.backend_inline asyneio track data -o out",
            silent=_NO_DEFECT,
            files=("out/tracks.png",),
        ),
    ),
    "X09": (
        Step(
            "MPLBACKEND=nonsense asyneio run data -o out",
            status=(0, 1),
            silent=_NO_DEFECT,
            files=("out/report.html",),
        ),
    ),
    "X24": (
        Step(
            "asyneio track data -o data",
            status=(1,),
            says=(r"contains the recording itself",),
            absent=("data/tracks.csv",),
        ),
        Step("asyneio track data -o out", files=("out/tracks.csv",)),
    ),
    "X04": (
        # A fast machine may have finished after eight seconds, so that there is nothing to interrupt.
        Step(
            _INTERRUPT,
            status=(0, 2),
            says=(r"interrupted.*\b130\b|wrote out/summary\.json",),
            silent=_NO_DEFECT,
        ),
        Step(
            _INTERRUPT.replace("sleep(8)", "sleep(2.5)"),
            status=(0, 2),
            says=(r"interrupted", r"\b130\b"),
            silent=_NO_DEFECT,
            own=True,
        ),
    ),
    "X11": (Step("set -o pipefail; asyneio doctor data | head -1; echo rc=$?", says=(r"rc=(0|141)\b",)),),
    "P01": (Step("python data/use.py; echo rc=$?", says=(r"240 x 180", r"rc=1\b"), silent=(r"rc=139",)),),
}
