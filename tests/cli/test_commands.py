"""Every command: help with an example that parses, errors of one paragraph, completion."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

from asyneio.cli.main import app
from asyneio.io import write_tracks_folder, write_uzh_folder
from tests.cli.conftest import Asyneio
from tests.cli.walk import COMMANDS, UsageError, parse
from tests.io.event_recordings import make_event_recording
from tests.io.recordings import make_recording

LEAVES = [name for name, command in COMMANDS.items() if not (name and hasattr(command, "commands"))]


@pytest.mark.parametrize("name", LEAVES, ids=lambda name: " ".join(name) or "asyneio")
def test_help_has_an_example_that_parses(asyneio: Asyneio, name: tuple[str, ...]) -> None:
    epilog = COMMANDS[name].epilog or ""
    examples = re.findall(r"asyneio [^\n]+", epilog)
    assert examples, f"{name} has no example"
    for example in examples:
        assert example.startswith(" ".join(("asyneio", *name)))
        parse(example)
    status, out, _ = asyneio(*name, "--help")
    assert status == 0
    assert "Example" in out
    assert COMMANDS[name].help


def test_help_texts_have_no_brackets() -> None:
    """`[s]` would be taken for markup and not be shown."""
    for name, command in COMMANDS.items():
        texts = [getattr(parameter, "help", "") or "" for parameter in command.params]
        assert not [text for text in texts if "[" in text.replace("[required]", "")], name


def test_a_wrong_command_line_does_not_parse() -> None:
    for wrong in ("asyneio runn x", "asyneio run", "asyneio run x --speed 3", "asyneio simulate moderate"):
        with pytest.raises(UsageError):
            parse(wrong)


@pytest.fixture
def _workplace(tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Invalid files of several kinds, and two valid recordings."""
    monkeypatch.chdir(tmp_path)
    Path("empty.bin").write_bytes(b"")
    Path("noise.bin").write_bytes(rng.bytes(4096))
    Path("folder").mkdir()
    Path("wrong.yaml").write_text("frontend: {trackers: haste}\n")
    Path("broken.yaml").write_text("frontend: {tracker: [\n")
    Path("list.yaml").write_text("- 1\n")
    Path("text.tum").write_text("this is no trajectory\n")
    Path("short.tum").write_text("1.0 0 0 0 0 0 0\n")
    Path("broken.npz").write_bytes(b"PK\x03\x04 and no more")
    Path("results.jsonl").write_text("not a result\n")
    write_tracks_folder(make_recording(rng, seconds=1.0), Path("tracks"))
    write_uzh_folder(make_event_recording(rng, count=500), Path("events"))
    os.mkfifo("pipe")


_WRONG = {
    "run": (
        ("absent",),
        ("empty.bin",),
        ("noise.bin",),
        ("folder",),
        ("events", "--max-track-seconds", "1"),
        ("tracks", "--max-track-seconds", "-1"),
        ("tracks", "--config", "absent.yaml"),
        ("tracks", "--config", "wrong.yaml"),
        ("tracks", "--config", "broken.yaml"),
        ("tracks", "--config", "list.yaml"),
        ("tracks", "--config", "noise.bin"),
        ("tracks", "--calibration", "text.tum"),
        ("tracks", "--imu", "absent.yaml"),
        ("tracks", "-o", "empty.bin"),
        ("tracks", "-o", "empty.bin/out"),
        ("events", "--preset", "EOS"),
        ("events", "--camera", "cam7"),
        ("events", "--events", "/dvs/events"),
        ("events", "--samples", "absent.txt"),
    ),
    "live": (
        ("camera",),
        ("file:absent",),
        ("file:noise.bin",),
        ("file:tracks",),
        ("file:events", "--speed", "-1"),
        ("file:events", "--speed", "nan"),
        ("file:events", "--max-backlog", "nan"),
        ("file:events", "--duration", "0"),
        ("file:events", "--record", "empty.bin"),
        ("file:events", "--listen", "port"),
        ("file:events", "--preset", "EOS"),
        ("socket:99999",),
        ("socket:5555", "--speed", "2"),
    ),
    "evaluate": (
        ("absent.tum", "text.tum"),
        ("text.tum", "text.tum"),
        ("short.tum", "short.tum"),
        ("folder", "text.tum"),
        ("noise.bin", "noise.bin"),
        ("broken.npz", "text.tum"),
        ("tracks/groundtruth.tum", "tracks/groundtruth.tum", "--protocol", "best"),
    ),
    "simulate": (
        ("calm", "-o", "out"),
        ("moderate", "-o", "out", "--duration", "0"),
        ("moderate", "-o", "out", "--duration", "nan"),
        ("moderate", "-o", "out", "--duration", "inf"),
        ("event_slow", "-o", "out", "--duration", "-1"),
        ("event_slow", "-o", "out", "--duration", "nan"),
        ("moderate", "-o", "empty.bin"),
        ("event_slow", "-o", "empty.bin/out"),
    ),
    "track": (
        ("absent",),
        ("empty.bin",),
        ("noise.bin",),
        ("folder",),
        ("tracks",),
        ("events", "--config", "wrong.yaml"),
        ("events", "--calibration", "absent.yaml"),
        ("events", "-o", "empty.bin/out"),
    ),
    "convert": (
        ("absent", "out.h5"),
        ("noise.bin", "out.h5"),
        ("tracks", "out.h5"),
        ("events", "out.xyz"),
        ("events", "out", "--to", "best"),
        ("events", "empty.bin/out.h5"),
        ("events", "events"),
    ),
    "config": (
        ("show", "absent.yaml"),
        ("show", "wrong.yaml"),
        ("show", "folder"),
        ("show", "--preset", "EOS"),
        ("diff", "noise.bin"),
        ("diff", "absent"),
    ),
    "bench": (
        ("uzh", "absent", "-o", "out"),
        ("uzh", "folder", "-o", "out"),
        ("uzh", "folder", "-o", "empty.bin"),
        ("uzh", ".", "-o", "out", "--sequences", "events", "--preset", "EOS"),
        ("uzh", ".", "-o", "out", "--sequences", "events", "--schemes", "gpif,best"),
        ("uzh", ".", "-o", "out", "--sequences", "events", "--set", "window.lenght_s=1"),
        ("uzh", ".", "-o", "out", "--sequences", "events", "--set", "window=1"),
        ("uzh", ".", "-o", "out", "--sequences", "events", "--seeds", "2"),
        ("tum-vie", "folder", "-o", "out"),
        ("vector", "folder", "-o", "out"),
        ("mvsec", "folder", "-o", "out"),
        ("dsec", "folder", "-o", "out"),
        ("evslam", "folder", "-o", "out"),
        ("simulated", "-o", "out", "--sequences", "calm"),
        ("simulated", "-o", "out", "--set", "window.length_s=-1"),
    ),
    "demo": (
        ("--duration", "0"),
        ("--duration", "-3"),
        ("--duration", "nan"),
        ("-o", "empty.bin"),
    ),
    "study": (
        ("schemes", "-o", "."),
        ("schemes", "-o", "empty.bin"),
        ("schemes", "-o", "empty.bin/out"),
    ),
}


@pytest.mark.parametrize(
    "arguments", [(name, *rest) for name, cases in _WRONG.items() for rest in cases], ids=" ".join
)
@pytest.mark.usefixtures("_workplace")
def test_errors_are_one_paragraph_with_a_fix(asyneio: Asyneio, arguments: tuple[str, ...]) -> None:
    status, out, err = asyneio(*arguments)
    assert (status, out) == (1, "")
    lines = [line for line in err.splitlines() if line.strip() and not line.startswith("note: ")]
    (message,) = [line for line in lines if line.startswith("asyneio: ")]
    assert message == lines[-1]
    assert "unexpected" not in message
    assert len(message) > 40
    # States what was expected, or what to do.
    assert re.search(r"expect|check|use|name |known|give|needs|;", message), message


def test_commands_with_wrong_inputs_are_all() -> None:
    groups = {name[0] for name in COMMANDS if name}
    # The doctor reports problems instead of failing.
    assert set(_WRONG) | {"doctor"} == groups


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "offered"),
    [("asyneio ru", "run"), ("asyneio run --sch", "--scheme"), ("asyneio study sch", "schemes")],
)
def test_completion(words: str, offered: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from asyneio.cli.main import main; main()"],
        env={
            **os.environ,
            "_ASYNEIO_COMPLETE": "complete_bash",
            "COMP_WORDS": words,
            "COMP_CWORD": str(len(words.split()) - 1),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert offered in done.stdout.split()


def test_completion_can_be_installed(asyneio: Asyneio) -> None:
    assert "--install-completion" in asyneio("--help")[1]
    assert isinstance(app, typer.Typer)
