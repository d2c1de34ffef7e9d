"""Run a tool of the project's environment, whichever that is, for the hooks of `pre-commit`.

Looks at the active virtual environment, then at `.venv` of this checkout, then at `.venv` of the checkout
that this worktree belongs to; on Windows as well.

    python tools/hook.py mypy
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


def _environments() -> Iterator[Path]:
    active = os.environ.get("ASYNEIO_VENV") or os.environ.get("VIRTUAL_ENV")
    if active:
        yield Path(active)
    yield _ROOT / ".venv"
    command = ["git", "-C", str(_ROOT), "rev-parse", "--path-format=absolute", "--git-common-dir"]
    common = subprocess.run(command, capture_output=True, text=True, check=False)
    if common.returncode == 0:
        yield Path(common.stdout.strip()).parent / ".venv"


def _find(tool: str) -> Path | None:
    names = (Path("bin") / tool, Path("Scripts") / f"{tool}.exe")
    return next((path for env in _environments() for name in names if (path := env / name).is_file()), None)


def main(tool: str, *arguments: str) -> int:
    """Run the tool in the root of the checkout; its exit status, 2 where it is not installed."""
    path = _find(tool)
    if path is None:
        looked = ", ".join(str(env) for env in _environments())
        print(f"{tool} is not installed in any of {looked}; `make lint` installs it.", file=sys.stderr)
        return 2
    return subprocess.run([str(path), *arguments], cwd=_ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
