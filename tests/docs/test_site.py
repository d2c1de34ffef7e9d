"""What the documentation names exists: pages, links, commands, options, Python names, formats."""

from __future__ import annotations

import importlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from asyneio.io.conversion.targets import TARGETS
from tests.cli.walk import UsageError, find

_REPOSITORY = Path(__file__).resolve().parents[2]
_DOCS = _REPOSITORY / "docs"
_PAGES = sorted(_DOCS.glob("*.md"))
_TEXTS = [*_PAGES, _REPOSITORY / "README.md", _REPOSITORY / "CONTRIBUTING.md"]

#: Of files that are called as a section of the settings is.
_ENDINGS = ("py", "json", "csv")


def prose(path: Path) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```$", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)


def anchors(path: Path) -> set[str]:
    """The fragments that headings of a page make, as Python-Markdown and GitHub agree on them."""
    titles = re.findall(r"^#+ (.+)$", prose(path), re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in titles}


@pytest.mark.parametrize("path", _TEXTS, ids=lambda path: path.name)
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
    assert "files-written-by-a-run" in anchors(_DOCS / "conventions.md")
    assert "files-never-written" not in anchors(_DOCS / "conventions.md")


def test_every_page_is_in_the_navigation() -> None:
    site = yaml.safe_load((_REPOSITORY / "mkdocs.yml").read_text())

    def pages(entry: Any) -> Iterator[str]:
        if isinstance(entry, str):
            yield entry
        else:
            for below in entry.values() if isinstance(entry, dict) else entry:
                yield from pages(below)

    assert sorted(pages(site["nav"])) == [path.name for path in _PAGES]
    # Nothing from elsewhere: fonts come from the reader's device.
    assert site["theme"]["font"] is False
    assert not {"extra_css", "extra_javascript"} & set(site)


def named_commands() -> list[tuple[str, str]]:
    """Page and command line, of blocks and of words within the text."""
    found = []
    for path in _TEXTS:
        text = path.read_text()
        lines = re.findall(r"^ {4,}(asyneio .+)$", text, re.MULTILINE)
        inline = [re.sub(r"\s+", " ", line) for line in re.findall(r"`(asyneio [^`]+)`", prose(path))]
        found += [(path.name, line.split(" #")[0]) for line in lines + inline]
    return found


def check(line: str) -> None:
    """Raises UsageError where the command, or one of its options, is not there."""
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
    from asyneio.config import Config

    sections = Config().model_dump()
    for path in _PAGES:
        for section, name in re.findall(r"`([a-z_]+)\.([a-z_]+)`", prose(path)):
            if section in sections:
                assert name in sections[section] or name in _ENDINGS, f"{path.name}: {section}.{name}"
