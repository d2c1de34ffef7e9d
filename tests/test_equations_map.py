"""`docs/equations.md` against the package: what it names exists; equations and lines have their place."""

from __future__ import annotations

import ast
import importlib
import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "equations.md"
ROOMS = (
    "trajectory",
    "inertial",
    "factors",
    "geometry",
    "frontend",
    "initialization",
    "estimation",
    "odometry",
)
#: The paper's equations, appendix included, and the lines of its Algorithm 1.
EQUATIONS = frozenset(range(1, 93))
LINES = frozenset(range(1, 25))

#: `(16)` or `(45)-(53)`, not the argument of a call and not a shape such as `(3,)`.
TAG = re.compile(r"(?<![\w\])])\((\d{1,2})\)(?:\s?-\s?\((\d{1,2})\))?")
CODE = re.compile(r"`([^`]+)`")


@dataclass(frozen=True)
class Row:
    """One line of the map."""

    equations: frozenset[int]
    functions: tuple[str, ...]
    tests: tuple[str, ...]


def tags(text: str) -> frozenset[int]:
    """Equation numbers in a text, ranges filled."""
    found: set[int] = set()
    for first, last in TAG.findall(text):
        found.update(range(int(first), int(last or first) + 1))
    return frozenset(found)


def section(title: str) -> str:
    """The part of the page under a heading."""
    body = PAGE.read_text().split(f"\n## {title}\n", 1)[1]
    return body.split("\n## ", 1)[0]


def table(title: str) -> Iterator[list[str]]:
    """Cells of the rows that begin with an equation."""
    for line in section(title).splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if tags(cells[0]):
            yield cells


@cache
def rows() -> tuple[Row, ...]:
    return tuple(
        Row(tags(cells[0]), tuple(CODE.findall(cells[3])), tuple(CODE.findall(cells[4])))
        for cells in table("Implemented")
    )


def plain_table(title: str) -> list[list[str]]:
    """Cells of all rows below the head of a table that has no equations of the paper."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


@cache
def unnumbered_rows() -> tuple[Row, ...]:
    """Lines of Algorithm 1 (as `equations`) and relations that have no number in the paper."""
    lines = [
        Row(
            tags(f"({cells[0].replace('-', ')-(')})"),
            tuple(CODE.findall(cells[2])),
            tuple(CODE.findall(cells[3])),
        )
        for cells in plain_table("Algorithm 1")
    ]
    relations = [
        Row(frozenset(), tuple(CODE.findall(cells[1])), tuple(CODE.findall(cells[2])))
        for title in ("The default tracker", "Other motion models", "Inertial schemes")
        for cells in plain_table(title)
    ]
    return (*lines, *relations)


def everything() -> tuple[Row, ...]:
    return (*rows(), *unnumbered_rows())


def mapped() -> frozenset[int]:
    return frozenset().union(*(row.equations for row in rows()))


def prose(source: str) -> Iterator[str]:
    """Docstrings and comments of a module."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            yield ast.get_docstring(node) or ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def modules() -> list[Path]:
    return [path for room in ROOMS for path in sorted((ROOT / "src" / "asyneio" / room).rglob("*.py"))]


def resolve(name: str) -> object:
    """The object `room.module.name` or `room.module.Class.name` of the package."""
    parts = name.split(".")
    for split in range(len(parts) - 1, 0, -1):
        try:
            found: object = importlib.import_module(".".join(["asyneio", *parts[:split]]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[split:]:
            found = getattr(found, attribute)
        return found
    raise ModuleNotFoundError(name)


@cache
def functions_in(path: str) -> frozenset[str]:
    tree = ast.parse((ROOT / path).read_text())
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


@pytest.mark.parametrize("name", sorted({name for row in everything() for name in row.functions}))
def test_every_named_function_exists(name: str) -> None:
    assert resolve(name) is not None


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({name for row in everything() for name in row.tests}))
def test_every_named_test_exists(name: str) -> None:
    path, function = name.split("::")
    assert (ROOT / path).is_file(), f"{path} does not exist"
    assert function.startswith("test_")
    assert function in functions_in(path), f"{path} has no {function}"


def test_functions_of_the_last_section_exist() -> None:
    names = {n for cells in table("Exact where the paper is first order") for n in CODE.findall(cells[2])}
    assert len(names) >= 5
    for name in names:
        assert resolve(name) is not None


def test_every_row_names_functions_and_tests() -> None:
    assert len(rows()) > 30
    assert len(unnumbered_rows()) > 15
    for row in everything():
        assert row.functions, f"{row} names no function"
        assert row.tests, f"{row} names no test"


def test_every_line_of_the_algorithm_has_one_place() -> None:
    lines = [line for row in unnumbered_rows() for line in row.equations]
    assert sorted(lines) == sorted(LINES)


def test_every_equation_of_the_paper_has_one_place() -> None:
    assert mapped() == EQUATIONS
    assert sum(len(row.equations) for row in rows()) == len(mapped()), "an equation stands in two rows"


@pytest.mark.parametrize("path", modules(), ids=lambda p: f"{p.parent.name}/{p.name}")
def test_every_tag_in_the_source_is_mapped(path: Path) -> None:
    missing = frozenset().union(*map(tags, prose(path.read_text()))) - mapped()
    assert not missing, (
        f"{path.name} carries the numbers {sorted(missing)}, which docs/equations.md does not map"
    )


@pytest.mark.slow
def test_source_carries_tags() -> None:
    """The search finds what it is meant to find: most equations are tagged where they are computed."""
    found = frozenset().union(*(tags(text) for path in modules() for text in prose(path.read_text())))
    assert {5, 8, 14, 15, 16, 20, 21, 24, 39, 40, 58} <= found
    assert len(found & mapped()) > 60


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("prior (16), rates (8)-(10)", {16, 8, 9, 10}),
        ("poses (N,4,4) or (4,4) (58).", {58}),
        ("out (6,) of f(3) and x[2](7)", set()),
        ("exact (46)-(48) and (75) - (76)", {46, 47, 48, 75, 76}),
        ("in 2014 (IJCV 2014), (100)", set()),
    ],
)
def test_tags_are_told_from_shapes_and_calls(text: str, numbers: set[int]) -> None:
    assert tags(text) == numbers


@pytest.mark.parametrize("name", ["trajectory.motion_prior.nothing", "nothing.at_all", "GPTrajectory.pose"])
def test_a_wrong_name_would_be_noticed(name: str) -> None:
    with pytest.raises((AttributeError, ModuleNotFoundError)):
        resolve(name)
