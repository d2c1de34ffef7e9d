# SPDX-License-Identifier: Apache-2.0
"""Results grouped by condition: curves with intervals, and maps of winners."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from asyneio.errors import StudyError
from asyneio.studies.records import Record
from asyneio.studies.statistics import Interval, median_interval, median_ratio
from asyneio.studies.study import Contest, Metric, Value, View

#: Relative differences smaller than this do not matter, even if significant.
_SAME = 0.005
#: Minimum number of pairs for significance: with four, all on one side has a probability of 6 %.
_FEWEST = 5

#: A point of a view: value of the factor across, label of the line.
Place = tuple[Value, str]


@dataclass(frozen=True)
class Gathered:
    """Intervals of one metric of a view, and the values of its factors in the order of the tasks."""

    metric: Metric
    xs: tuple[Value, ...]
    lines: tuple[str, ...]
    cells: Mapping[Place, Interval]


@dataclass(frozen=True)
class Winner:
    """The best of one cell of a contest.

    `equals` are rivals that are statistically equal to the winner: the 95 % interval of their ratio to it,
    paired by seed, reaches 1, or the ratio is within half a percent, or there are fewer than five seeds.
    `margin` is the ratio of the second best to the winner, infinite if that failed.
    """

    name: str
    middle: float
    margin: Interval
    equals: tuple[str, ...]


def gather(view: View, records: Sequence[Record]) -> tuple[Gathered, ...]:
    """The metrics of a view over the seeds.

    Raises:
        StudyError: a point of the view mixes conditions.
    """
    chosen = [record for record in records if _at(record.task, view.where)]
    places: dict[Place, list[Record]] = {}
    for record in chosen:
        place = (record.task[view.across], label_of(record.task, view.lines))
        places.setdefault(place, []).append(record)
    for place, members in places.items():
        _check_one_condition(view.name, place, members)
    xs = _ordered(x for x, _ in places)
    lines = tuple(dict.fromkeys(line for _, line in places))
    return tuple(
        Gathered(
            metric,
            xs,
            lines,
            {
                place: median_interval([member.measured[metric.name] for member in members])
                for place, members in places.items()
            },
        )
        for metric in view.metrics
    )


def decide(contest: Contest, records: Sequence[Record]) -> dict[tuple[Value, Value], Winner]:
    """The winner of every cell (row, column) in which at least two rivals have results of common seeds."""
    cells: dict[tuple[Value, Value], dict[str, dict[int, float]]] = {}
    for record in records:
        if _at(record.task, contest.where):
            cell = cells.setdefault((record.task[contest.rows], record.task[contest.columns]), {})
            rival = cell.setdefault(label_of(record.task, contest.rivals), {})
            rival[int(record.task["seed"])] = record.measured[contest.metric.name]
    decided = {place: _winner(rivals) for place, rivals in cells.items()}
    return {place: winner for place, winner in decided.items() if winner is not None}


def label_of(task: Mapping[str, Value], factors: Sequence[str]) -> str:
    """The values of factors in one phrase."""
    return " ".join(str(task[factor]) for factor in factors)


def _winner(rivals: Mapping[str, Mapping[int, float]]) -> Winner | None:
    seeds = sorted(set.intersection(*(set(values) for values in rivals.values())))
    if len(rivals) < 2 or not seeds:
        return None
    figures = {name: [values[seed] for seed in seeds] for name, values in rivals.items()}
    middles = {name: median_interval(values).middle for name, values in figures.items()}
    best, second, *_ = sorted(middles, key=lambda name: middles[name])
    ratios = {name: median_ratio(values, figures[best]) for name, values in figures.items() if name != best}
    equals = tuple(
        name
        for name, ratio in ratios.items()
        if len(seeds) < _FEWEST or min(ratio.low, ratio.middle - _SAME) <= 1.0
    )
    return Winner(best, middles[best], ratios[second], equals)


def _at(task: Mapping[str, Value], where: Mapping[str, Value]) -> bool:
    return all(task[factor] == value for factor, value in where.items())


def _ordered(values: Iterable[Value]) -> tuple[Value, ...]:
    """Unique values; numbers ascending, names in order of appearance."""
    unique = list(dict.fromkeys(values))
    numbers = [value for value in unique if not isinstance(value, str)]
    return tuple(sorted(numbers)) if len(numbers) == len(unique) else tuple(unique)


def _check_one_condition(view: str, place: Place, members: Sequence[Record]) -> None:
    conditions = {
        tuple((factor, value) for factor, value in member.task.items() if factor != "seed")
        for member in members
    }
    if len(conditions) > 1:
        raise StudyError(
            f"view {view} at {place} mixes {len(conditions)} conditions, {sorted(map(str, conditions))[:2]}; "
            "expected one: name the factor among its lines or in `where`"
        )
