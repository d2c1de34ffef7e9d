"""What the documentation names exists: pages, links, commands, options, settings, Python names, formats."""

from __future__ import annotations

import importlib
import re
import shlex
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

from asyneio.config import Config
from asyneio.io.conversion.targets import TARGETS
from tests.cli.walk import UsageError, find

_REPOSITORY = Path(__file__).resolve().parents[2]
_DOCS = _REPOSITORY / "docs"
_PAGES = sorted(_DOCS.rglob("*.md"))
_TEXTS = [*_PAGES, *(_REPOSITORY / f"{name}.md" for name in ("README", "CONTRIBUTING", "CHANGELOG"))]

#: Endings of files whose name is also that of a section of the settings.
_ENDINGS = ("py", "json", "csv")


def prose(path: Path) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```$", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)


def anchors(path: Path) -> set[str]:
    """The fragments of a page's headings, where Python-Markdown and GitHub agree."""
    titles = re.findall(r"^#+ (.+)$", prose(path), re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in titles}


@pytest.mark.parametrize("path", _TEXTS, ids=lambda path: str(path.relative_to(_REPOSITORY)))
def test_internal_links_lead_somewhere(path: Path) -> None:
    for link in re.findall(r"\]\(\s*([^)]+)\)", prose(path).replace("\n", " ")):
        if re.match(r"https?:", link):
            continue
        name, _, fragment = link.partition("#")
        target = (path.parent / name).resolve() if name else path
        assert target.exists(), link
        if fragment:
            assert fragment in anchors(target), link


def test_a_broken_link_is_noticed(tmp_path: Path) -> None:
    assert "files-written-by-a-run" in anchors(_DOCS / "files.md")
    assert "files-never-written" not in anchors(_DOCS / "files.md")


def test_every_page_is_in_the_navigation() -> None:
    site = yaml.safe_load((_REPOSITORY / "mkdocs.yml").read_text())

    def pages(entry: Any) -> Iterator[str]:
        if isinstance(entry, str):
            yield entry
        else:
            for below in entry.values() if isinstance(entry, dict) else entry:
                yield from pages(below)

    assert sorted(pages(site["nav"])) == sorted(str(path.relative_to(_DOCS)) for path in _PAGES)
    # No external resources: fonts come from the reader's device.
    assert site["theme"]["font"] is False
    assert not {"extra_css", "extra_javascript"} & set(site)


def named_commands() -> list[tuple[str, str]]:
    """Page and command line, from blocks and from inline code."""
    found = []
    for path in _TEXTS:
        text = path.read_text()
        lines = re.findall(r"^ {4,}(asyneio .+)$", text, re.MULTILINE)
        inline = [re.sub(r"\s+", " ", line) for line in re.findall(r"`(asyneio [^`]+)`", prose(path))]
        found += [(path.name, line.split(" #")[0]) for line in lines + inline]
    return found


def check(line: str) -> None:
    """Raises UsageError if the command or one of its options does not exist."""
    command, rest = find(shlex.split(line)[1:])
    known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    for word in rest:
        if word.startswith("-") and word.split("=")[0] not in known | {"--help"}:
            raise UsageError(f"{line}: no option {word}")


def test_commands_and_options_exist() -> None:
    lines = named_commands()
    assert len(lines) > 30
    for page, line in lines:
        words = line.split()
        if words[1] == "COMMAND" or "..." in words[1]:
            continue
        try:
            check(line)
        except UsageError as error:
            pytest.fail(f"{page}: {error}")


@pytest.mark.parametrize("wrong", ["asyneio fly x", "asyneio run x --height 3", "asyneio evaluate a b -q"])
def test_a_wrong_command_is_noticed(wrong: str) -> None:
    with pytest.raises(UsageError):
        check(wrong)


def test_python_names_exist() -> None:
    named = re.findall(r"^::: (\S+)$", (_DOCS / "api.md").read_text(), re.MULTILINE)
    assert len(named) > 20
    for name in named:
        module, _, attribute = name.rpartition(".")
        if name != "asyneio.errors":
            assert hasattr(importlib.import_module(module), attribute), name


def test_every_format_that_is_written_is_listed() -> None:
    text = (_DOCS / "formats.md").read_text()
    written = re.findall(r"^\| `(\w[\w-]+)` \|", text[text.index("## Written") :], re.MULTILINE)
    assert sorted(written) == sorted(target.name for target in TARGETS)


def test_settings_that_are_named_exist() -> None:
    """A name that begins like a section is a setting, or a module of the package of that name."""
    sections = Config().model_dump()
    for path in _PAGES:
        for section, name in re.findall(r"`([a-z_]+)\.([a-z_]+)`", prose(path)):
            if section in sections and name not in sections[section] and name not in _ENDINGS:
                assert find_spec(f"asyneio.{section}.{name}") is not None, f"{path.name}: {section}.{name}"
