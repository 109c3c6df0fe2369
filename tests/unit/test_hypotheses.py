"""The hypotheses of a bank: their sets, which are published and how far they reach, and how rows are taken over."""

from __future__ import annotations

from statistics import NormalDist
from typing import Any

import numpy as np
import pytest

from milepost.fusion.hypotheses import DECORRELATION_S, HARD, NOBODY, PLAUSIBLE, Doubts, Rows, Suspect, sources

A, B, C = (frozenset(x) for x in "abc")


def doubts(rates: dict[str, float], **options: Any) -> Doubts:
    return Doubts(tuple(Suspect(unit, rate, 10.0) for unit, rate in rates.items()), **options)


RARE = {"a": 1e-5, "b": 2e-5, "c": 3e-5}
OFTEN = {"a": 1e-3, "b": 2e-3, "c": 1e-5}


def flags(rows: Rows, *alive: Any) -> np.ndarray:
    return np.array([units in alive for units in rows.sets])


def test_a_bank_begins_with_nobody_each_alone_and_every_two() -> None:
    single, pairs = doubts(RARE).sets(NOBODY)
    assert single == {NOBODY: 1.0, A: 1e-5, B: 2e-5, C: 3e-5}
    assert pairs == pytest.approx({A | B: 2e-10, A | C: 3e-10, B | C: 6e-10})


def test_the_risk_is_that_of_a_decorrelation_time() -> None:
    assert doubts(OFTEN).risk == pytest.approx(1e-4 * DECORRELATION_S / 3600.0)


def test_units_with_a_common_cause_are_one_hypothesis() -> None:
    single, pairs = doubts(OFTEN, groups=((A | B, 4e-3),)).sets(NOBODY)
    assert list(single) == [NOBODY, A, B, C, A | B]
    assert single[A | B] == 4e-3
    # both by themselves is the group's set, and no row is there twice
    assert set(pairs) == {A | C, B | C, A | B | C}


def test_every_set_beside_an_exclusion_contains_what_is_excluded() -> None:
    single, pairs = doubts(OFTEN).sets(A)
    assert list(single) == [A, A | B, A | C]
    # row 0 has probability 1, although a as a cause has its own
    assert single[A] == 1.0
    assert single[A | B] == 2e-3
    assert all(units > A for units in pairs)


def test_a_row_uses_the_units_outside_its_set() -> None:
    rows = Rows(doubts(OFTEN), NOBODY)
    assert rows.sets == (NOBODY, A, B, C, A | B, A | C, B | C)
    assert rows.uses("a").tolist() == [True, False, True, True, False, False, True]
    assert rows.uses("c").tolist() == [True, True, True, False, True, False, False]
    assert rows.uses("never heard of").all()
    assert all(rows.sets[place] == units for units, place in rows.places.items())


def test_one_cause_more_is_published_and_not_two() -> None:
    rows = Rows(doubts(OFTEN), NOBODY)
    everything = np.ones(7, dtype=bool)
    assert rows.published(everything).tolist() == [True, True, True, True, False, False, False]


def test_refuted_rows_are_not_published() -> None:
    rows = Rows(doubts(OFTEN), NOBODY)
    assert rows.published(flags(rows, NOBODY, B)).tolist() == [True, False, True, False, False, False, False]


def test_all_that_is_plausible_is_published_once_row_0_is_refuted() -> None:
    """b is the likeliest of those left, 2e-3: a stays, at half of it; c at 1e-5 and the pair at 2e-6 do not count."""
    rows = Rows(doubts(OFTEN), NOBODY)
    alive = flags(rows, A, B, C, A | B)
    assert PLAUSIBLE * 2e-3 > 1e-5
    assert rows.plausible(alive).tolist() == rows.published(alive).tolist() == [False, True, True, False, False, False, False]


def test_what_may_lead_is_published_beside_a_likelier_explanation_of_what_is_excluded() -> None:
    """a is excluded, and c is the likelier explanation of that: one more liar, b, leads, and c stands beside it."""
    rows = Rows(doubts({"a": 1e-5, "b": 1e-4, "c": 1e-2}), A, frozenset((C,)))
    alive = flags(rows, A | B, C)
    assert rows.plausible(alive).tolist() == flags(rows, A | B).tolist()
    assert rows.published(alive).tolist() == flags(rows, A | B, C).tolist()


def test_the_unlikely_is_plausible_where_nothing_else_is_left() -> None:
    rows = Rows(doubts(OFTEN), NOBODY)
    assert rows.published(flags(rows, C, A | B)).tolist() == [False, False, False, True, True, False, False]
    assert rows.published(flags(rows, A | B)).tolist() == [False, False, False, False, True, False, False]


def test_the_smallest_is_contained_in_all_others_or_there_is_none() -> None:
    rows = Rows(doubts(OFTEN), NOBODY)
    assert rows.smallest(flags(rows, A, A | B)) == rows.places[A]
    assert rows.smallest(flags(rows, C)) == rows.places[C]
    assert rows.smallest(flags(rows, A, B, A | B)) is None
    assert rows.smallest(np.ones(7, dtype=bool)) == 0


def test_the_reach_of_each_row_is_the_one_by_hand() -> None:
    """Risk 2.8e-7 over four published rows: 6.9e-8 for row 0, 6.9e-8/p for the others, and one sigma at least."""
    rows = Rows(doubts(OFTEN, risk_per_hour=1e-4), NOBODY)
    published, reach = rows.intervals(np.ones(7, dtype=bool), 0)
    assert published.tolist() == [True, True, True, True, False, False, False]
    each = 1e-4 * 10.0 / 3600.0 / 4.0
    expected = [-NormalDist().inv_cdf(0.5 * each / p) for p in (1.0, 1e-3, 2e-3, 1e-5)]
    assert reach == pytest.approx([max(1.0, k) for k in expected], rel=1e-9)
    assert reach[0] == pytest.approx(5.39, abs=0.01)
    assert reach[1] == pytest.approx(3.98, abs=0.01)


def test_what_noise_seldom_says_makes_the_other_rows_likelier() -> None:
    """Row 0's worst test is as bad in one of 1000 cases: 1e-3, 2e-3 and 1e-5 become 1 at most, 1 and 0.01; row 0 stays at 1."""
    rows = Rows(doubts(OFTEN, risk_per_hour=1e-4), NOBODY)
    _, reach = rows.intervals(np.ones(7, dtype=bool), 0, 3)
    each = 1e-4 * 10.0 / 3600.0 / 4.0
    expected = [-NormalDist().inv_cdf(0.5 * each / p) for p in (1.0, 1.0, 1.0, 1e-2)]
    assert reach == pytest.approx(expected, rel=1e-9)


def test_the_row_that_leads_is_always_published() -> None:
    """c is far less likely than b, and may lead all the same where rows were taken over: its mean lies in what is published."""
    rows = Rows(doubts(OFTEN), NOBODY)
    alive = flags(rows, B, C)
    assert not rows.published(alive)[rows.places[C]]
    assert rows.intervals(alive, rows.places[C])[0].tolist() == flags(rows, B, C).tolist()


def test_the_risk_summed_over_the_published_rows_is_the_budget() -> None:
    rows = Rows(doubts(OFTEN), NOBODY)
    for alive in (np.ones(7, dtype=bool), flags(rows, NOBODY, A), flags(rows, NOBODY)):
        published, reach = rows.intervals(alive, 0)
        spent = sum(p * 2.0 * NormalDist().cdf(-k) for p, k in zip(rows.chances[published], reach, strict=True))
        assert spent <= rows.doubts.risk * (1.0 + 1e-9)
        assert spent > 0.7 * rows.doubts.risk


def test_once_row_0_is_refuted_the_likeliest_counts_as_certain() -> None:
    """b is twice as likely as a: K of b is that of the risk shared by two, K of a that of twice as much."""
    rows = Rows(doubts(OFTEN), NOBODY)
    published, reach = rows.intervals(flags(rows, A, B), rows.places[B])
    assert np.flatnonzero(published).tolist() == [rows.places[A], rows.places[B]]
    each = rows.doubts.risk / 2.0
    assert reach[1] == pytest.approx(-NormalDist().inv_cdf(0.5 * each), rel=1e-9)
    assert reach[0] == pytest.approx(-NormalDist().inv_cdf(0.5 * each * 2.0), rel=1e-9)


def test_on_exclusion_each_row_continues_itself_or_the_new_row_0() -> None:
    train = doubts(OFTEN)
    old, new = Rows(train, NOBODY), Rows(train, A)
    alive = flags(old, A, A | B, C)
    index = sources(new, old, alive, lambda s: (s,), old.places[A])
    assert [old.sets[i] for i in index] == [A if units != A | B else A | B for units in new.sets]
    # a refuted row is not continued
    index = sources(new, old, flags(old, A), lambda s: (s,), old.places[A])
    assert [old.sets[i] for i in index] == [A] * len(new.sets)


def test_on_readmission_each_row_continues_the_one_without_the_unit() -> None:
    train = doubts(OFTEN)
    old, new = Rows(train, A), Rows(train, NOBODY)
    index = sources(new, old, np.ones(len(old.sets), dtype=bool), lambda s: (s | A,), 0)
    assert [old.sets[i] for i in index] == [units | A for units in new.sets]


def test_a_unit_that_was_blamed_is_likelier_to_lie_again_than_others_to_have_lain() -> None:
    rows = Rows(doubts(OFTEN), NOBODY, frozenset((B | C,)), A)
    chances = dict(zip(rows.sets, rows.chances.tolist(), strict=True))
    assert chances == pytest.approx({NOBODY: 1.0, A: 1.0, B: 2e-3, C: 1e-5, A | B: 2e-3, A | C: 1e-5, B | C: 2e-5})


def test_on_readmission_a_row_that_never_left_the_unit_out_goes_on_by_itself() -> None:
    train = doubts(OFTEN)
    old, new = Rows(train, A, frozenset((B | C,))), Rows(train, NOBODY, frozenset((B | C,)), A)
    index = sources(new, old, np.ones(len(old.sets), dtype=bool), lambda s: (s, s | A), 0)
    assert {units: old.sets[i] for units, i in zip(new.sets, index, strict=True)} == {
        units: B | C if units == B | C else units | A for units in new.sets
    }


def test_the_first_of_several_wanted_rows_that_lives_is_continued() -> None:
    train = doubts(OFTEN)
    old, new = Rows(train, NOBODY), Rows(train, B)
    index = sources(new, old, flags(old, NOBODY, C), lambda s: (s, s - B), old.places[C])
    assert {units: old.sets[i] for units, i in zip(new.sets, index, strict=True)} == {
        units: NOBODY if units - B == NOBODY else C for units in new.sets
    }


# --- a train that moves harder than its motion model


def test_hard_motion_is_one_cause_more() -> None:
    single, pairs = doubts(OFTEN, hard_motion_probability=1e-6).sets(NOBODY)
    assert single == {NOBODY: 1.0, A: 1e-3, B: 2e-3, C: 1e-5, HARD: 1e-6}
    assert HARD not in doubts({}, hard_motion_probability=1e-6).sets(NOBODY)[0]
    assert {units: p for units, p in pairs.items() if units > HARD} == pytest.approx(
        {A | HARD: 1e-9, B | HARD: 2e-9, C | HARD: 1e-11}
    )


def test_what_explains_an_exclusion_otherwise_is_published_beside_it() -> None:
    """a is excluded, or b and c lie alike: 2e-8 beside the 1e-3 of a. Two causes beside a are left to the tests."""
    rows = Rows(doubts(OFTEN), A, frozenset((B | C,)))
    everything = np.ones(len(rows.sets), dtype=bool)
    assert set(np.array(rows.sets, dtype=object)[rows.published(everything)]) == {A, A | B, A | C, B | C}
    assert rows.chances[rows.places[B | C]] == pytest.approx(2e-3 * 1e-5 / 1e-3)


def test_it_stays_so_likely_when_the_unit_is_readmitted() -> None:
    """That a lay and healed is no more certain than it was: b and c stay at 2e-8 beside the 1e-3 of a."""
    rows, before = Rows(doubts(OFTEN), NOBODY, frozenset((B | C,)), A), Rows(doubts(OFTEN), NOBODY)
    assert rows.sets == before.sets
    everything = np.ones(len(rows.sets), dtype=bool)
    new = rows.published(everything) & ~before.published(everything)
    assert [rows.sets[i] for i in np.flatnonzero(new)] == [B | C]
    reach = dict(zip(np.flatnonzero(rows.published(everything)).tolist(), rows.intervals(everything, 0)[1], strict=True))
    assert reach[rows.places[B | C]] == pytest.approx(-NormalDist().inv_cdf(0.5 * rows.doubts.risk / 5.0 / 2e-5), rel=1e-9)


def test_the_rows_of_hard_motion_are_known_by_place() -> None:
    rows = Rows(doubts(OFTEN, hard_motion_probability=1e-6), A)
    assert [rows.sets[i] for i in rows.hard] == [A | HARD, A | B | HARD, A | C | HARD]
    assert len(Rows(doubts(OFTEN), A).hard) == 0


def test_an_alternative_has_the_chance_of_its_causes_over_those_excluded() -> None:
    """Hard motion 1e-6 against a 1e-3, and against a and b 2e-6, which are likelier still as one cause, 4e-3."""
    train = doubts(OFTEN, hard_motion_probability=1e-6)
    rows = Rows(train, A, frozenset((HARD,)))
    assert rows.chances[rows.places[HARD]] == pytest.approx(1e-3)
    rows = Rows(train, A | B, frozenset((HARD,)))
    assert rows.chances[rows.places[HARD]] == pytest.approx(0.5)
    common = doubts(OFTEN, hard_motion_probability=1e-6, groups=((A | B, 4e-3),))
    rows = Rows(common, A | B, frozenset((HARD,)))
    assert rows.chances[rows.places[HARD]] == pytest.approx(2.5e-4)
    assert rows.published(np.ones(len(rows.sets), dtype=bool))[rows.places[HARD]]


def test_another_explanation_is_plausible_only_where_nothing_goes_on_from_the_exclusion() -> None:
    """b and c, which agree with each other, are rarely both wrong: it is asked last. Hard motion is one cause, and is not."""
    rows = Rows(doubts(OFTEN, hard_motion_probability=1e-4), A, frozenset((HARD, B | C)))
    beside = flags(rows, A | C, HARD, B | C)
    assert rows.plausible(beside).tolist() == flags(rows, HARD).tolist()
    assert rows.plausible(flags(rows, A | C, B | C)).tolist() == flags(rows, A | C).tolist()
    assert rows.plausible(flags(rows, B | C)).tolist() == flags(rows, B | C).tolist()
    # though nobody follows it, it stays in the interval
    assert rows.published(flags(rows, A | C, B | C)).tolist() == flags(rows, A | C, B | C).tolist()


def test_with_one_wheel_excluded_the_others_are_as_likely_as_their_common_cause() -> None:
    """Alone 1e-5; but a slip of both, 4e-4, is two fifths of the first's own fault."""
    rates = {"a": 1e-3, "b": 1e-5}
    assert doubts(rates).sets(A)[0][A | B] == 1e-5
    assert doubts(rates, groups=((A | B, 4e-4),)).sets(A)[0][A | B] == pytest.approx(0.4)
    assert doubts(rates, groups=((A | B, 4e-3),)).sets(A)[0][A | B] == 1.0


def test_another_explanation_by_one_cause_is_not_one_of_several() -> None:
    """Beside a: that b lies, or both wheels b and c slip, is one cause; that the train moves hard beside it, is two."""
    train = doubts(OFTEN, hard_motion_probability=1e-6, groups=((B | C, 4e-3),))
    rows = Rows(train, A, frozenset((B, B | C, C | HARD)))
    assert [rows.sets[i] for i in np.flatnonzero(rows.several)] == [C | HARD]
    assert not Rows(train, NOBODY).several.any()
