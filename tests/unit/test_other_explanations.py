"""What explains an exclusion otherwise: by which evidence it is refuted, and where it goes on from after a readmission."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from banks import Fault, Moment, Ride, accelerometer, between, bias, reader, speedometer

FIRST, SECOND, THIRD = (speedometer(unit, phase_s=0.015 * i) for i, unit in enumerate(("first", "second", "third")))
TRAIN = Ride((FIRST, SECOND, THIRD, reader(hz=0.1)))
INERTIAL = Ride((FIRST, SECOND, accelerometer(), reader(hz=0.1)))
SPEEDS = frozenset(("first", "second"))
OTHERS = frozenset(("second", "third"))
FROM_S, TO_S, FIX_S, NEXT_FIX_S = 12.0, 17.0, 20.017, 30.017
each_seed = pytest.mark.parametrize("seed", [1, 2, 3])


def ramps(*spells: tuple[float, float]) -> Fault:
    """Reads 0.1 m/s more with each second of a spell: a train may accelerate so, and who hears it alone cannot tell."""
    return lambda t_s, z, noise: z + sum(0.1 * (t_s - from_s) for from_s, to_s in spells if from_s <= t_s < to_s)


def held(moment: Moment) -> bool:
    """Whether it is held possible that the two others lie instead of the first."""
    place = moment.bank.rows.places.get(OTHERS)
    return OTHERS in moment.bank.rows.alternatives and place is not None and bool(moment.bank.alive[place])


def within(moments: list[Moment], from_s: float, to_s: float) -> list[Moment]:
    out = [m for m in moments if from_s < m.t_s < to_s]
    assert out
    return out


@each_seed
def test_one_fix_that_fits_the_exclusion_refutes_that_two_others_lie_instead_which_it_does_not_fit(seed: int) -> None:
    """GIVEN one reads ever more WHEN a fix is where the two others say THEN nobody holds that they lie, and it does too."""
    moments = list(replace(TRAIN, seed=seed).moments(NEXT_FIX_S, {"first": ramps((FROM_S, 99.0))}))
    assert all(m.excluded == {"first"} and held(m) for m in within(moments, FIX_S - 1.0, FIX_S - 0.001))
    assert all(m.excluded == {"first"} and not held(m) for m in within(moments, FIX_S + 0.001, NEXT_FIX_S))
    assert all(m.holds() for m in moments)


@each_seed
def test_one_fix_that_fits_nothing_refutes_no_explanation(seed: int) -> None:
    """GIVEN the same WHEN the balise is 30 m from its place on the map THEN that balise is refused, and both are held."""
    faults = {"first": ramps((FROM_S, 99.0)), "reader": between(FIX_S - 0.1, FIX_S + 0.1, bias(30.0))}
    moments = list(replace(TRAIN, seed=seed).moments(NEXT_FIX_S, faults))
    assert all(m.excluded == {"first"} and held(m) for m in within(moments, FIX_S + 0.001, NEXT_FIX_S))
    assert all(m.holds() for m in moments)


@each_seed
def test_two_that_begin_to_lie_alike_soon_after_a_third_was_readmitted_are_held_possible(seed: int) -> None:
    """GIVEN one lied and is heard again WHEN the others read ever more, alike, and it is excluded THEN the truth is inside."""
    lies = {"first": ramps((FROM_S, TO_S)), "second": ramps((32.0, 99.0)), "third": ramps((32.0, 99.0))}
    moments = list(replace(TRAIN, seed=seed).moments(39.0, lies))
    assert all(not m.excluded for m in within(moments, 30.0, 32.0))
    again = [m for m in within(moments, 32.0, 39.0) if m.excluded]
    assert again
    assert all(m.excluded == {"first"} and held(m) and m.holds() for m in again)


@each_seed
def test_a_hypothesis_of_two_liars_begins_where_the_train_is_when_a_third_is_readmitted(seed: int) -> None:
    """GIVEN an excluded accelerometer WHEN it is readmitted THEN that both speeds lie goes on from what is published.

    Not from the hypothesis that all three lie, which hears nobody and whose uncertainty grows without end.
    """
    lies = {"accelerometer": between(12.0, 18.0, bias(0.4))}
    moments = list(replace(INERTIAL, seed=seed).moments(FIX_S, lies))
    back = next(m for m in moments if m.t_s > 18.0 and not m.excluded)
    places = back.bank.rows.places
    alone, all_heard = (math.sqrt(back.bank.P[places[units], 0, 0]) for units in (SPEEDS, frozenset()))
    assert back.bank.alive[places[SPEEDS]]
    assert alone < 1.1 * all_heard
    assert all(m.holds() for m in moments)
