"""Single pages: the first screen of the README, the length of the results, names of modules and tests."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from asyneio.config import Config

from .banned import ROOT, pages
from .print_functions import resolve

README = (ROOT / "README.md").read_text()
RESULTS = (ROOT / "docs" / "results.md").read_text()
TITLE = "AsynEIO: Asynchronous Monocular Event-Inertial Odometry Using Gaussian Process Regression"
PACKAGE = ROOT / "src" / "asyneio"
#: Endings of files whose name is also that of a package.
_FILES = ("py", "json", "csv", "tum", "npz")


def flat(text: str) -> str:
    """Words of a text on one line, without marks of quotation and emphasis."""
    return re.sub(r"[\s>*{}]+", " ", text)


def test_the_first_screen_says_what_it_is() -> None:
    screen = "\n".join(README.splitlines()[:40])
    assert TITLE in flat(screen)
    for part in (
        "Zhixiang Wang",
        "Panfeng Huang",
        "arxiv.org/abs/2411.12175",
        "It needs",
        "You get",
        "](docs/images/",
    ):
        assert part in flat(screen), part
    assert (
        len(re.findall(r"^    (?:pip|asyneio) .*$", "\n".join(README.splitlines()[:15]), re.MULTILINE)) == 2
    )
    assert len(README.splitlines()) <= 120


def test_the_paper_can_be_cited() -> None:
    (entry,) = re.findall(r"^```bibtex\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    assert entry.startswith("@article{")
    assert TITLE in flat(re.sub(r"[{}]", "", entry))
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    paper = citation["preferred-citation"]
    assert paper["title"] == TITLE
    assert len(paper["authors"]) == 5
    assert paper["doi"] in entry
    changed = re.search(r"^## \[([\d.]+)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert changed is not None
    assert changed.group(1) == citation["version"]


def test_figures_of_the_readme_are_those_of_the_results() -> None:
    rows = [line for line in README.splitlines() if line.startswith("| **asyneio**")]
    assert len(rows) == 2
    figures = {figure for row in rows for figure in re.findall(r"\d+\.\d+", row)}
    assert len(figures) >= 5
    assert {figure for figure in figures if figure not in RESULTS} == set()


def test_results_are_short_and_name_command_commit_and_kind() -> None:
    assert len(RESULTS.splitlines()) <= 150
    for title, text in re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", RESULTS, re.MULTILINE | re.DOTALL):
        if title == "Targets that are not met":
            continue
        assert re.search(r"\b[0-9a-f]{7}\b", text), f"{title}: no commit"
        assert re.search(r"\d{4}-\d{2}-\d{2}", text), f"{title}: no date"
        assert re.search(r"`(python benchmarks/|asyneio bench)", text), f"{title}: no command"
        assert re.search(r"simulation|real|hybrid", text, re.IGNORECASE), f"{title}: no kind of evidence"


def test_benchmarks_that_are_named_exist() -> None:
    for path in pages():
        for script in re.findall(r"\bbenchmarks/\w+\.py", path.read_text()):
            assert (ROOT / script).is_file(), f"{path.name}: {script}"


def test_the_order_of_packages_is_that_of_the_contracts() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = [layer.replace("asyneio.", "") for layer in contracts[0]["layers"]]
    block = re.search(r"^    cli.*\n(?:    .+\n)+", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    assert block is not None
    assert block.group().replace("    ", "").splitlines() == layers


def test_every_package_is_described() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text()
    table = page[page.index("\n## Packages\n") : page.index("\n## The front end\n")]
    packages = [folder.name for folder in PACKAGE.iterdir() if (folder / "__init__.py").is_file()]
    assert [name for name in packages if not re.search(rf"^\|[^|]*`{name}`", table, re.MULTILINE)] == []


def inline(path: Path) -> list[str]:
    """Inline code of a page, outside blocks."""
    prose = re.sub(r"^```.*?^```$", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"`([^`\n]+)`", prose)


@pytest.mark.parametrize("path", pages(), ids=lambda path: str(path.relative_to(ROOT)))
def test_python_names_exist(path: Path) -> None:
    """`room.module.name`, with or without `asyneio` in front, that is no setting."""
    if path.name == "CHANGELOG.md":
        pytest.skip("names of earlier versions")
    rooms = {folder.name for folder in PACKAGE.iterdir() if folder.is_dir()} | {"asyneio"}
    sections = Config().model_dump()
    for name in inline(path):
        first, *others = name.split(".")
        if not re.fullmatch(r"\w+(\.\w+)+", name) or first not in rooms or others[-1] in _FILES:
            continue
        if first in sections and others[0] in sections[first]:
            continue
        full = name if first == "asyneio" else f"asyneio.{name}"
        try:
            resolve(full)
        except (AttributeError, ModuleNotFoundError):
            pytest.fail(f"{path.name}: {name} does not exist")


@pytest.mark.parametrize("path", pages(), ids=lambda path: str(path.relative_to(ROOT)))
def test_tests_and_modules_that_are_named_exist(path: Path) -> None:
    scripts = (ROOT / "benchmarks").glob("*.py")
    modules = [str(file) for file in (*PACKAGE.rglob("*.py"), *scripts)]
    for name in inline(path):
        if match := re.fullmatch(r"(tests/[\w/]+\.py)(?:::(\w+))?", name):
            file, function = match.groups()
            assert (ROOT / file).is_file(), f"{path.name}: {name}"
            assert function is None or f"def {function}(" in (ROOT / file).read_text(), f"{path.name}: {name}"
        elif re.fullmatch(r"[a-z]\w*(/\w+)*\.py", name) and not name.startswith(("benchmarks/", "examples/")):
            assert any(module.endswith(f"/{name}") for module in modules), (
                f"{path.name}: {name} does not exist"
            )
        elif re.fullmatch(r"(gradient|haste|odometry|estimation|pipeline|frontend)(/\w+)+/?", name):
            target = PACKAGE / name.rstrip("/")
            inside = PACKAGE / "frontend" / name.rstrip("/")
            assert any(p.is_dir() or p.with_suffix(".py").is_file() for p in (target, inside)), (
                f"{path.name}: {name}"
            )
