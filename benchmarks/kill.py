"""A run that is killed at random moments and resumed, compared with an uninterrupted one.

    python benchmarks/kill.py [--kills 20] [--seed 0] [--scene event_room] [--seconds 5]

Simulation. Each row is an `asyneio run` in a process of its own that `kill -9` ends at a random moment of one
of four phases: start (reading the recording), the first third of the run (loading kernels, initialization),
the rest of the run (tracking), and writing. Moments are drawn evenly over the phases of an uninterrupted run
and counted in processor time, which depends little on the load of the machine. Half of the runs are started
without options, the others with `--checkpoint 0.2`. `asyneio run --resume` then continues. All files must be
those of the uninterrupted run to the byte, except the section `timing` of `summary.json` and the times in
`report.html`.

Drawing the report takes most of the time and begins after the other files, so that it is drawn only where the
run is killed while it writes; elsewhere matplotlib is hidden.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asyneio.pipeline.simulated import write_simulated_events
from asyneio.simulation import EVENT_SCENARIOS
from common import table

REPORT_FILES = ("report.html", "overview.png")
PHASES = ("start", "first third", "tracking", "writing")
#: Parts of the report that show wall-clock times.
_TIMES = re.compile(
    rb"[0-9.]+ s, [0-9.]+ times real time|tracked at [0-9.]+ Mev/s|<h2>Processing time</h2>.*?</figure>",
    re.DOTALL,
)
_POLL_S = 0.005


@dataclass(frozen=True)
class Reference:
    """An uninterrupted run: its files, and when its phases end [s of processor time]."""

    files: dict[str, bytes]
    ends_s: tuple[float, ...]


def command(recording: Path, out: Path, *options: str, draws: bool = True) -> list[str]:
    """The command of one run; without a report, matplotlib is hidden."""
    hidden = "import sys; sys.modules['matplotlib'] = None; from asyneio.cli.main import main; main()"
    program = ["-m", "asyneio"] if draws else ["-c", hidden]
    return [sys.executable, *program, "run", str(recording), "-o", str(out), *options]


def contents(folder: Path) -> dict[str, bytes]:
    """Files of a folder, without times."""
    found = {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    if "summary.json" in found:
        found["summary.json"] = json.dumps({**json.loads(found["summary.json"]), "timing": {}}).encode()
    if "report.html" in found:
        found["report.html"] = _TIMES.sub(b"", found["report.html"])
    return found


def reference(recording: Path, out: Path) -> Reference:
    """Run without interruption; the phases end when the folder shows it."""
    process = subprocess.Popen(command(recording, out), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    seen: dict[Path, float] = {}
    used_s = 0.0
    while process.poll() is None:
        used_s = max(used_s, processor_s(process.pid))
        for path in (out / ".asyneio.lock", out / "summary.json"):
            if path not in seen and path.exists():
                seen[path] = used_s
        time.sleep(_POLL_S)
    if process.returncode:
        raise RuntimeError(process.stderr.read().decode() if process.stderr else "")
    locked_s, written_s = (seen[out / name] for name in (".asyneio.lock", "summary.json"))
    third_s = locked_s + (written_s - locked_s) / 3.0
    return Reference(contents(out), (locked_s, third_s, written_s, used_s))


def processor_s(process: int) -> float:
    """Processor time of a process so far [s]; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def killed(arguments: list[str], after_s: float) -> bool:
    """Start a run and kill it; False if it had ended."""
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None:
        if processor_s(process.pid) >= after_s:
            process.kill()
            process.wait()
            return True
        time.sleep(_POLL_S)
    return False


def row(number: int, phase: str, after_s: float, recording: Path, out: Path, wanted: Reference) -> list[str]:
    """Kill one run, resume it and compare."""
    options = ("--checkpoint", "0.2") if number // len(PHASES) % 2 else ()
    draws = phase == "writing"
    was_killed = killed(command(recording, out, *options, draws=draws), after_s)
    left = sorted(path.name for path in out.rglob("*") if path.is_file()) if out.exists() else []
    checkpoint = any(name.startswith("state_") for name in left)
    again = command(recording, out, *options, "--resume", draws=draws)
    resumed = subprocess.run(again, capture_output=True, text=True, check=False)
    found = contents(out) if out.exists() else {}
    lines = [line for line in resumed.stderr.splitlines() if "resumed after" in line]
    files = {name: data for name, data in wanted.files.items() if draws or name not in REPORT_FILES}
    different = sorted(name for name in {*found, *files} if found.get(name) != files.get(name))
    return [
        str(number),
        phase,
        f"{after_s:.2f}",
        "yes" if was_killed else "had ended",
        " ".join(options) or "none",
        f"{len(left)} files, {'a' if checkpoint else 'no'} checkpoint",
        re.sub(r" of the recording", "", lines[0]) if lines else "from the beginning",
        str(resumed.returncode),
        "identical" if not different else f"DIFFERENT: {', '.join(different)}",
    ]


def main() -> None:
    """Print a row for each kill; the exit status is 1 if a file differs."""
    parser = argparse.ArgumentParser(description="Kill and resume a run.")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scene", default="event_room")
    parser.add_argument("--seconds", type=float, default=5.0)
    chosen = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rng = np.random.default_rng(chosen.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenario = replace(EVENT_SCENARIOS[chosen.scene], duration_s=chosen.seconds)
        (folder / "recording").mkdir()
        write_simulated_events(scenario, folder / "recording", True, lambda _: None)
        # The first run fills the cache of the file system.
        reference(folder / "recording", folder / "warm")
        wanted = reference(folder / "recording", folder / "reference")
        print(f"phases end after {', '.join(f'{end:.2f} s' for end in wanted.ends_s)}", flush=True)
        again = contents(folder / "warm")
        print(f"two uninterrupted runs: {'identical' if again == wanted.files else 'DIFFERENT'}", flush=True)
        begins = (0.0, *wanted.ends_s)
        rows = []
        for number in range(chosen.kills):
            phase = number % len(PHASES)
            after_s = float(rng.uniform(begins[phase], begins[phase + 1]))
            out = folder / "out"
            rows.append(row(number, PHASES[phase], after_s, folder / "recording", out, wanted))
            print(" | ".join(rows[-1]), flush=True)
            shutil.rmtree(out, ignore_errors=True)
    header = ["", "phase", "processor s", "killed", "options", "left behind", "resumed", "status", "files"]
    print("\n" + table(header, rows))
    sys.exit(any(cells[-1] != "identical" for cells in rows))


if __name__ == "__main__":
    main()
