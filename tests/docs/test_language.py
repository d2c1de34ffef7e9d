"""Plain English: no banned phrase in pages, docstrings, comments and messages."""

from __future__ import annotations

from pathlib import Path

import pytest

from .banned import (
    BANNED,
    ROOT,
    find,
    hits_in_page,
    hits_in_source,
    pages,
    prose_of_page,
    rooms,
    texts_of_source,
)


@pytest.mark.parametrize("path", pages(), ids=lambda path: str(path.relative_to(ROOT)))
def test_pages(path: Path) -> None:
    assert [f"{path.name}:{hit.line}: {hit.words}" for hit in hits_in_page(path)] == []


@pytest.mark.slow
@pytest.mark.parametrize("room", rooms())
def test_docstrings_comments_and_messages(room: str) -> None:
    hits = [hit for path in rooms()[room] for hit in hits_in_source(path)]
    assert [f"{hit.path.relative_to(ROOT)}:{hit.line}: {hit.words}" for hit in hits] == []


def test_phrases_are_found_across_lines_and_in_any_case() -> None:
    assert list(find("Read are\nall formats, whose verdict\nis told.")) == [
        (1, "Read are"),
        (2, "verdict"),
        (3, "told"),
    ]
    assert list(find("The track goes\non.")) == [(1, "goes on")]
    assert list(find("kind of evidence, a progress bar, the rest of the window, refused_share")) == []


def test_code_is_not_searched() -> None:
    page = "Text.\n```\nis told\n```\n    asyneio run told\n`told` [told](told.md)\n"
    assert [words for _, words in find(prose_of_page(page))] == ["told"]
    source = '"""What is told."""\nrefused = 1  # nobody knows\nx = f"{refused} is refused"\n'
    found = {words for _, text in texts_of_source(source) for _, words in find(text)}
    assert found == {"told", "nobody", "refused"}


def test_every_phrase_has_a_replacement() -> None:
    assert all(BANNED.values())
    assert len(BANNED) > 50
