"""Gathering by condition, deciding who wins, and how both read."""

from __future__ import annotations

import csv
import io
import math

import pytest

from asyneio.errors import StudyError
from asyneio.studies.records import Record
from asyneio.studies.study import Contest, Metric, Study, View
from asyneio.studies.tables import contest_markdown, number, records_csv, view_csv, view_markdown
from asyneio.studies.views import decide, gather
from tests.studies import stub

_ERROR = Metric("error", "error", "m")
_VIEW = View("v", "title", (_ERROR,), "size", ("method",))


def record(method: str, size: int, seed: int, error: float, kind: str = "a") -> Record:
    return Record({"method": method, "size": size, "kind": kind, "seed": seed}, "s", "c", {"error": error})


def records() -> list[Record]:
    """`good` wins at 1 clearly, nobody at 2, `bad` fails at 3."""
    errors = {("good", 1): 1.0, ("bad", 1): 2.0, ("good", 2): 5.0, ("bad", 2): 5.0, ("good", 3): 7.0}
    noise = {0: 0.0, 1: 0.1, 2: -0.1, 3: 0.2, 4: -0.2}
    found = [
        record(method, size, seed, error + (noise[seed] if method == "good" else -noise[seed]))
        for seed in noise
        for (method, size), error in errors.items()
    ]
    return found + [record("bad", 3, seed, math.nan) for seed in noise]


def test_gather_finds_medians_of_every_place() -> None:
    (gathered,) = gather(_VIEW, records())
    assert gathered.xs == (1, 2, 3)
    assert gathered.lines == ("good", "bad")
    assert gathered.cells[1, "good"].middle == 1.0
    assert gathered.cells[1, "good"].count == 5
    assert gathered.cells[3, "bad"].failed == 5


def test_gather_keeps_to_where() -> None:
    other = [record("good", 9, 0, 1.0, kind="b")]
    view = View("v", "title", (_ERROR,), "size", ("method",), {"kind": "a"})
    assert gather(view, records() + other) == gather(_VIEW, records())


def test_mixed_conditions_are_refused() -> None:
    mixed = [record("good", 1, 0, 1.0, kind="a"), record("good", 1, 0, 9.0, kind="b")]
    with pytest.raises(StudyError, match=r"view v .* mixes 2 conditions"):
        gather(_VIEW, mixed)


def test_the_winner_and_those_that_equal_it() -> None:
    decided = decide(Contest("c", "title", _ERROR, ("method",), "size", "kind"), records())
    assert list(decided) == [(1, "a"), (2, "a"), (3, "a")]
    clear, tie, alone = decided.values()
    assert (clear.name, clear.middle, clear.equals) == ("good", 1.0, ())
    assert clear.margin.middle == pytest.approx(2.0)
    assert len(tie.equals) == 1
    assert (alone.name, alone.equals) == ("good", ())
    assert alone.margin.middle == math.inf


def test_certain_but_tiny_differences_are_no_victory() -> None:
    close = [record(m, 1, seed, e) for seed in range(10) for m, e in (("good", 1.0), ("bad", 1.001))]
    (winner,) = decide(Contest("c", "title", _ERROR, ("method",), "size", "kind"), close).values()
    assert winner.equals == ("bad",)


def test_few_seeds_decide_nothing() -> None:
    few = [found for found in records() if found.task["seed"] != 0]
    (first, *_) = decide(Contest("c", "title", _ERROR, ("method",), "size", "kind"), few).values()
    assert (first.name, first.equals) == ("good", ("bad",))


def test_only_common_seeds_are_compared() -> None:
    partial = [record("good", 1, 0, 1.0), record("good", 1, 1, 100.0), record("bad", 1, 0, 2.0)]
    contest = Contest("c", "title", _ERROR, ("method",), "size", "kind")
    assert decide(contest, partial)[1, "a"].middle == 1.0
    assert decide(contest, partial[:2]) == {}
    assert decide(contest, partial[1:]) == {}


def test_tables_for_readers() -> None:
    text = view_markdown("size [m]", gather(_VIEW, records()))
    head, rule, *rows = text.splitlines()[2:]
    assert head == "| size [m] | good | bad |"
    assert rule == "|---|---|---|"
    assert rows[0].startswith("| 1 | **1** [0.8, 1.2] | 2 [1.8, 2.2] |")
    assert rows[1].count("**5**") == 2
    assert rows[2].endswith("fails [fails, fails], 5 of 5 fail |")
    contest = Contest("c", "title", _ERROR, ("method",), "size", "kind")
    study: Study = stub.stub_study()
    words = contest_markdown(study, contest, decide(contest, records()))
    assert "| 1 | good 1 (next: 2x) |" in words
    assert "| 3 | good 7 (others fail) |" in words
    assert "(equal: " in words


def test_tables_for_machines() -> None:
    rows = list(csv.DictReader(io.StringIO(view_csv("size", gather(_VIEW, records())))))
    assert len(rows) == 6
    assert (rows[0]["size"], rows[0]["line"], float(rows[0]["error_median"])) == ("1", "good", 1.0)
    assert rows[5]["error_failed"] == "5"
    tasks = list(csv.DictReader(io.StringIO(records_csv(records()))))
    assert len(tasks) == 30
    assert float(tasks[0]["error"]) == 1.0


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.012345, "0.0123"), (12.345, "12.3"), (4321.9, "4322"), (1.5e-7, "1.5e-07"), (math.inf, "fails")],
)
def test_numbers(value: float, text: str) -> None:
    assert number(value) == text
