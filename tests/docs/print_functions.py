"""Functions printed in pages: `<!-- source: dotted.name -->`, then a block of Python.

The block is the source of the function in the package, dedented and without its docstring, which is in the
API reference. `python tests/docs/print_functions.py` lists the blocks that differ; `--write` replaces them.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"(<!-- source: ([\w.]+) -->\n```python\n)(.*?)(^```$)", re.MULTILINE | re.DOTALL)


def resolve(name: str) -> object:
    """The object with this dotted name."""
    parts = name.split(".")
    for split in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:split]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[split:]:
            found = getattr(found, attribute)
        return found
    raise ModuleNotFoundError(name)


def without_docstring(source: str) -> str:
    """The source of one function, dedented, without the lines of its docstring."""
    source = textwrap.dedent(source)
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    lines = source.splitlines()
    first = function.body[0]
    if (
        isinstance(first, ast.Expr)
        and isinstance(first.value, ast.Constant)
        and isinstance(first.value.value, str)
    ):
        assert first.end_lineno is not None
        del lines[first.lineno - 1 : first.end_lineno]
    return "\n".join(lines).strip() + "\n"


def source_of(name: str) -> str:
    """Source of a function or a Numba kernel as a page prints it."""
    found = resolve(name)
    return without_docstring(inspect.getsource(getattr(found, "py_func", found)))  # type: ignore[arg-type]


def refreshed(page: str) -> str:
    """A page with every block as the package has it."""
    return BLOCK.sub(lambda m: m.group(1) + source_of(m.group(2)) + m.group(4), page)


def pages() -> list[Path]:
    """Pages that print functions."""
    return [path for path in sorted((ROOT / "docs").rglob("*.md")) if BLOCK.search(path.read_text())]


def main() -> int:
    """List or replace blocks that differ; 1 where some differ and are not replaced."""
    stale = [path for path in pages() if refreshed(path.read_text()) != path.read_text()]
    for path in stale:
        print(path.relative_to(ROOT))
        if "--write" in sys.argv:
            path.write_text(refreshed(path.read_text()))
    return 1 if stale and "--write" not in sys.argv else 0


if __name__ == "__main__":
    raise SystemExit(main())
