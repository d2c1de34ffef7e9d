"""Commands in surroundings of all sorts: they work, or say in one sentence why not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from asyneio.io import open_recording, write_tracks_folder
from asyneio.io.parsing.hdf5_output import new_hdf5
from asyneio.io.ros.sensor_clock import REPLAYED, fit_clock
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.pipeline.packets import check_inertial_scales
from asyneio.types import EventRecording, Packet, StepReport
from tests.cli.conftest import Asyneio
from tests.cli.fakes import FakeOdometry
from tests.io.recordings import make_recording


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    write_tracks_folder(make_recording(rng, seconds=3.0), tmp_path / "desk")
    return tmp_path / "desk"


def command(*arguments: str | Path, **variables: str) -> subprocess.Popen[bytes]:
    script = "from asyneio.cli.main import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)],
        env=os.environ | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.mark.slow
def test_who_stops_reading_does_not_change_the_exit_status(folder: Path) -> None:
    """As `asyneio doctor RECORDING | head -1`."""
    process = command("doctor", folder)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    said = process.stderr.read().decode()
    assert process.wait() == 0, said
    assert "defect" not in said


@pytest.mark.slow
def test_settings_that_cannot_be_obeyed_are_said(tmp_path: Path) -> None:
    _, said = command("doctor", tmp_path / "absent", NUMBA_DISABLE_JIT="1").communicate()
    assert b"NUMBA_DISABLE_JIT is ignored" in said


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["nonsense", "module://nowhere.backend_inline"])
def test_figures_need_no_backend(backend: str) -> None:
    pytest.importorskip("matplotlib")
    script = (
        "import os; from asyneio.viz.style import plotting, new_figure, to_png\n"
        "with plotting(): png = to_png(new_figure(1, 2.0)[0])\n"
        f"assert png[:4] == b'\\x89PNG' and os.environ['MPLBACKEND'] == {backend!r}"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"MPLBACKEND": backend},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()


def test_a_name_that_is_no_text_is_written_with_marks(folder: Path) -> None:
    odd = Path(os.fsdecode(os.fsencode(folder.parent) + b"/old\xff\xfename"))
    try:
        folder.rename(odd)
    except OSError:
        pytest.skip("the file system takes text only")
    recording = open_recording(odd)
    assert recording.name == "old\ufffd\ufffdname"
    " ".join((recording.name, *recording.notes)).encode()


class Interrupted(FakeOdometry):
    """Ctrl-C after a second."""

    def process(self, packet: Packet) -> tuple[list, StepReport]:
        self.packets = getattr(self, "packets", 0) + 1
        if self.packets > self.allowed:
            raise KeyboardInterrupt
        return super().process(packet)

    allowed = 20


class InterruptedAtOnce(Interrupted):
    """Ctrl-C before there is anything."""

    allowed = 0


@pytest.mark.parametrize("estimator", [Interrupted, InterruptedAtOnce])
def test_ctrl_c_keeps_what_there_is_and_says_so(
    estimator: type[Interrupted],
    asyneio: Asyneio,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", estimator)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    status, _, said = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 130
    assert "interrupted after" in said
    kept = (tmp_path / "out" / "trajectory.tum").is_file()
    assert kept == (estimator is Interrupted)
    assert ("nothing is written" in said) != kept
    assert (tmp_path / "out").exists() == kept


def test_an_hdf5_file_on_a_full_disk_ends_in_an_error_and_no_crash() -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full here")
    with pytest.raises(OSError, match="No space left"), new_hdf5(full) as file:
        file["numbers"] = np.arange(1000)


def test_results_do_not_go_among_a_recording_of_events(asyneio: Asyneio, tmp_path: Path) -> None:
    place = tmp_path / "desk"
    place.mkdir()
    rows = [f"{0.001 * k:.6f} {k % 120} {k % 90} {k % 2}" for k in range(3000)]
    (place / "events.txt").write_text("\n".join(rows) + "\n")
    for recording in (place, place / "events.txt"):
        status, _, said = asyneio("track", recording, "-o", place)
        assert status == 1
        assert "contains the recording itself" in said
    assert sorted(file.name for file in place.iterdir()) == ["events.txt"]


def test_a_run_refuses_a_factor_in_the_accelerometer(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    recording = open_recording(folder)
    assert not isinstance(recording, EventRecording)
    check_inertial_scales(recording)
    recording.accelerometer["xyz"] *= 0.5
    write_tracks_folder(recording, tmp_path / "half")
    status, _, said = asyneio("run", tmp_path / "half", "-o", tmp_path / "out")
    assert status == 1
    assert "reads gravity as 4.9" in said
    assert not (tmp_path / "out").exists()


def test_stamps_of_a_replay_are_said() -> None:
    sensor = np.arange(0, 1_200_000_000, 30_000_000, dtype=np.int64)
    host = 10**18 + sensor // 5
    assert any(REPLAYED in text and "0.2 s per second" in text for text in fit_clock(sensor, host, "e").notes)
    assert not any(REPLAYED in text for text in fit_clock(sensor, 10**18 + sensor + 10**6, "e").notes)


@pytest.mark.slow
def test_a_terminal_without_columns(folder: Path) -> None:
    process = command("doctor", folder, COLUMNS="0")
    assert b"usable" in process.communicate()[0]
    assert process.returncode in (0, 1)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_standard_output_is_named(folder: Path) -> None:
    script = "from asyneio.cli.main import main; main()"
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-c", script, "doctor", str(folder)],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
        )
    assert done.returncode == 1
    assert b"cannot write standard output: No space left on device" in done.stderr
    assert b"Traceback" not in done.stderr


@pytest.mark.slow
def test_a_working_directory_that_was_deleted(folder: Path, tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    leave = f"import os; os.chdir({str(gone)!r}); os.rmdir({str(gone)!r})"
    script = f"{leave}; from asyneio.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", script, "doctor", "../desk"], stderr=subprocess.PIPE, check=False
    )
    assert done.returncode == 1
    assert b"the working directory no longer exists" in done.stderr
