"""The package as a library: light to import, a dozen names, one version, quiet unless logging is set up."""

from __future__ import annotations

import ast
import logging
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import asyneio

_REPOSITORY = Path(__file__).resolve().parent.parent


def test_import_loads_nothing_heavy() -> None:
    """The names load on first use; a fresh interpreter shows it, and how long the import takes."""
    code = (
        "import sys, time; started = time.perf_counter(); import asyneio; "
        "seconds = time.perf_counter() - started; "
        "heavy = {'numpy', 'numba', 'scipy', 'pydantic', 'h5py', 'matplotlib'} & set(sys.modules); "
        "print(seconds, *heavy); asyneio.Estimate; print('numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    first, second = done.stdout.splitlines()
    seconds, *heavy = first.split()
    assert heavy == []
    # 25 ms on an idle machine; tests run side by side.
    assert float(seconds) < 1.0
    assert second == "True"


def test_names() -> None:
    assert dir(asyneio) == sorted(asyneio.__all__)
    assert len(asyneio.__all__) <= 15
    for name in asyneio.__all__:
        assert getattr(asyneio, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = asyneio.Nothing  # type: ignore[attr-defined]


def test_names_are_those_that_type_checkers_see() -> None:
    tree = ast.parse((_REPOSITORY / "src/asyneio/__init__.py").read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert typed == asyneio._MODULES
    assert {*typed, "__version__"} == set(asyneio.__all__)


def test_one_version() -> None:
    project = tomllib.loads((_REPOSITORY / "pyproject.toml").read_text())["project"]
    assert project["version"] == asyneio.__version__


def imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            yield from [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_benchmarks_and_examples_do_not_import_the_command_line() -> None:
    """Outside the package, import contracts do not reach."""
    scripts = [path for folder in ("benchmarks", "examples") for path in (_REPOSITORY / folder).rglob("*.py")]
    assert len(scripts) > 20
    for path in scripts:
        assert not [name for name in imported(path) if name.startswith("asyneio.cli")], path.name


@pytest.mark.slow
def test_the_library_does_not_print() -> None:
    """Only the command line does, and the child processes that count compiled kernels."""
    for path in (_REPOSITORY / "src/asyneio").rglob("*.py"):
        if "cli" in path.parts:
            continue
        calls = [
            node.lineno
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
        ]
        assert len(calls) == (path.name == "compilation.py"), f"{path.name}: {calls}"


def test_nothing_is_shown_without_a_handler(capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.getLogger("asyneio.io")
    assert any(isinstance(handler, logging.NullHandler) for handler in logging.getLogger("asyneio").handlers)
    logger.warning("not shown")
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_the_command_line_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "asyneio", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"asyneio {asyneio.__version__}\n"
