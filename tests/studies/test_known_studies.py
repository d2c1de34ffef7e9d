"""The studies themselves: grids without repetition or mixture, measurements against what must hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from asyneio.simulation.imu import specific_force_b
from asyneio.studies import expressiveness as priors
from asyneio.studies import preintegration as rules
from asyneio.studies.catalogue import STUDIES
from asyneio.studies.known_motion import MotionKind, draw_known_motion, generalized_rates
from asyneio.studies.records import Record
from asyneio.studies.study import Study, task_key, task_values
from asyneio.studies.views import decide, gather


def placeholder_records(study: Study) -> list[Record]:
    """A record for every task, with figures that depend on nothing but the seed."""
    names = {m.name for v in study.views for m in v.metrics} | {c.metric.name for c in study.contests}
    return [
        Record(task_values(task), "s", "c", dict.fromkeys(names, 1.0 + task.seed)) for task in study.tasks
    ]


@pytest.mark.slow
@pytest.mark.parametrize("quick", [True, False])
@pytest.mark.parametrize("name", STUDIES)
def test_grids_are_complete(name: str, quick: bool) -> None:
    assert len({task.seed for task in STUDIES[name](quick, None).tasks}) == (2 if quick else 10)
    study = STUDIES[name](quick, 2)
    seeds = {task.seed for task in study.tasks}
    assert study.name == name
    assert len({task_key(task_values(task)) for task in study.tasks}) == len(study.tasks)
    records = placeholder_records(study)
    for view in study.views:
        # A view that mixed conditions would raise; one seed of each is in every place.
        for gathered in gather(view, records):
            assert {cell.count for cell in gathered.cells.values()} <= {len(seeds)}
    if not quick:
        assert all(len(gather(view, records)[0].xs) > 1 for view in study.views)
        assert all(len(decide(contest, records)) > 1 for contest in study.contests)
    assert len({item.name for item in (*study.views, *study.contests)}) == len(study.views) + len(
        study.contests
    )


@pytest.mark.parametrize("name", STUDIES)
def test_seeds_are_asked_for_and_change_no_fingerprint(name: str) -> None:
    few, many = STUDIES[name](False, 1), STUDIES[name](False, 3)
    assert {task.seed for task in many.tasks} == {0, 1, 2}
    assert set(few.tasks) < set(many.tasks)
    assert few.fingerprint == many.fingerprint
    assert few.fingerprint == STUDIES[name](True, None).fingerprint
    assert replace(few, settings={**few.settings, "more": 1}).fingerprint != few.fingerprint


@pytest.mark.parametrize("kind", MotionKind)
def test_rates_are_derivatives(kind: MotionKind, rng: np.random.Generator) -> None:
    motion = draw_known_motion(kind, 1.3, rng)
    t, h = np.linspace(0.1, 2.0, 20), 1e-5
    before, after = (generalized_rates(motion, t + step) for step in (-h, h))
    np.testing.assert_allclose(
        (after[:, 0] - before[:, 0]) / (2 * h), generalized_rates(motion, t)[:, 1], atol=1e-5
    )


def test_the_orbit_is_almost_a_constant_twist(rng: np.random.Generator) -> None:
    rates = generalized_rates(draw_known_motion("orbit", 1.0, rng), np.linspace(0.0, 4.0, 200))[:, 0]
    speed = np.linalg.norm(rates.reshape(-1, 2, 3), axis=2)
    assert np.abs(speed.mean(axis=0) - np.pi).max() < 0.2
    assert (rates.std(axis=0) < np.pi / 6.0).all()


_EXPRESSIVE = priors.ExpressivenessTask("wnoj", "se3", "rotation", 1.0, 50, "exact", 0)


def test_errors_between_exact_knots_fall_as_the_prior_predicts() -> None:
    """Quintic and cubic interpolation: the pose to sixth and fourth order, the rate one order less."""
    for prior, order in (("wnoj", 6.0), ("wnoa", 4.0)):
        coarse, fine = (
            priors.measure(replace(_EXPRESSIVE, prior=prior, interval_ms=interval)) for interval in (50, 25)
        )
        for name, expected in (
            ("rotation_deg", order),
            ("position_mm", order),
            ("rate_deg_s", order - 1.0),
            ("velocity_mm_s", order - 1.0),
        ):
            assert np.log2(coarse[name] / fine[name]) == pytest.approx(expected, abs=0.15), name


def test_priors_and_spaces_meet_the_same_motion() -> None:
    all_four = [
        priors.measure(replace(_EXPRESSIVE, prior=prior, space=space))
        for prior in priors.PRIORS
        for space in priors.SPACES
    ]
    assert len({measured["motion_rate_rad_s"] for measured in all_four}) == 1
    assert all_four[0]["motion_rate_rad_s"] == pytest.approx(3.2, rel=0.4)
    # Attitude does not know of the space that the position is regressed in.
    assert all_four[0]["rotation_deg"] == pytest.approx(all_four[1]["rotation_deg"], rel=1e-3)
    assert all_four[2]["position_mm"] != pytest.approx(all_four[3]["position_mm"], rel=1e-3)


def test_the_space_of_the_orbit_is_se3() -> None:
    for prior in priors.PRIORS:
        task = replace(_EXPRESSIVE, prior=prior, motion="orbit", interval_ms=200)
        se3, apart = (priors.measure(replace(task, space=s))["position_mm"] for s in priors.SPACES)
        assert 2.0 * se3 < apart


def test_noisy_knots_set_a_floor() -> None:
    exact, noisy = (priors.measure(replace(_EXPRESSIVE, knots=k)) for k in ("exact", "noisy"))
    # A millimetre and a thousandth of a radian in each axis; between two knots about half of the variance.
    assert 0.8 < noisy["position_mm"] < 3.0**0.5 < 2.0
    assert 0.05 < noisy["rotation_deg"] < np.rad2deg(3.0**0.5 * 1e-3)
    assert exact["position_mm"] < 1e-3


_WINDOW = rules.PreintegrationTask("midpoint", 0.1, 200, "none", 0)


def test_true_increments_are_the_integrals_of_what_an_imu_measures(rng: np.random.Generator) -> None:
    motion, start, duration = draw_known_motion("both", 1.0, rng), 0.7, 0.2
    C, nu, r = rules.true_increments(motion, start, duration)
    t = start + np.linspace(0.0, duration, 4001)
    T = motion.T_w_b(t)
    np.testing.assert_allclose(C, T[0, :3, :3].T @ T[-1, :3, :3], atol=1e-12)
    force = np.einsum("ji,njk,nk->ni", T[0, :3, :3], T[:, :3, :3], specific_force_b(motion, t, 9.81))
    velocity = cumulative_trapezoid(force, t, axis=0, initial=0.0)
    np.testing.assert_allclose(nu, velocity[-1], atol=1e-7)
    np.testing.assert_allclose(r, cumulative_trapezoid(velocity, t, axis=0)[-1], atol=1e-7)


def test_rules_meet_the_same_samples_and_rank_as_they_must() -> None:
    hold, midpoint, gpp = (rules.measure(replace(_WINDOW, rule=rule)) for rule in rules.RULES)
    for name in ("rotation_deg", "velocity_mm_s", "position_mm"):
        assert hold[name] > 5.0 * midpoint[name] > 50.0 * gpp[name]
    assert 0.0 < midpoint["cost_ms"] < 1e3


def test_the_midpoint_rule_is_of_second_order() -> None:
    coarse, fine = (rules.measure(replace(_WINDOW, rate_hz=rate)) for rate in (200, 1000))
    assert coarse["position_mm"] / fine["position_mm"] == pytest.approx(25.0, rel=0.6)


def test_noise_sets_the_floor_of_the_best_rule() -> None:
    """White noise of density n on the force leaves n sqrt(T^3 / 3) of position on each of three axes."""
    task = replace(_WINDOW, rule="gpp", noise="low", window_s=0.2)
    errors = [rules.measure(replace(task, seed=seed))["position_mm"] for seed in range(3)]
    floor = 1e3 * 2e-3 * np.sqrt(0.2**3)
    assert np.median(errors) == pytest.approx(floor, rel=0.25)


@pytest.mark.parametrize(
    ("measure", "task"),
    [(priors.measure, replace(_EXPRESSIVE, knots="noisy")), (rules.measure, replace(_WINDOW, noise="high"))],
)
def test_the_same_task_gives_the_same_figures(
    measure: Callable[[object], dict[str, float]], task: object
) -> None:
    first, second = measure(task), measure(task)
    first.pop("cost_ms", None)
    assert {name: second[name] for name in first} == first
