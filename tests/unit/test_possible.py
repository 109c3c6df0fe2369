"""What the bank holds possible, as it is told to people: each hypothesis, its belief, and what is thought of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from banks import Fault, Ride, between, bias, reader, receiver, speedometer
from milepost.estimation.beliefs import joined
from milepost.fusion.bank_state import Bank
from milepost.fusion.possible import Possible, possible

RIDE = Ride([speedometer("radar"), speedometer("radar-2", phase_s=0.02), receiver(), reader()])
ALONE = [(), ("radar",), ("radar-2",), ("reader",), ("receiver",)]


def bank_at(t_s: float, faults: Mapping[str, Fault]) -> Bank:
    return list(RIDE.moments(t_s, faults))[-1].bank


def judgements(bank: Bank) -> dict[tuple[str, ...], str]:
    return {each.without: each.judgement for each in possible(bank)}


def test_of_an_honest_train_each_unit_may_lie_and_that_none_does_is_published() -> None:
    bank = bank_at(10.0, {})
    assert judgements(bank) == {(): "leads"} | dict.fromkeys(ALONE[1:], "held")


def test_of_a_liar_found_those_that_believe_it_are_refuted() -> None:
    found = judgements(bank_at(10.0, {"radar": between(5.0, 20.0, bias(2.0))}))
    assert found.pop(("radar",)) == "leads"
    assert all("radar" in without for without in found)
    assert found[("radar", "receiver")] == "held"


def test_the_figures_are_those_of_the_hypothesis() -> None:
    bank = bank_at(10.0, {})
    for each in possible(bank):
        row = bank.rows.places[frozenset(each.without)]
        assert each.position == pytest.approx((bank.x[row, 0], np.sqrt(bank.P[row, 0, 0])))
        assert each.speed == pytest.approx((bank.x[row, 1], np.sqrt(bank.P[row, 1, 1])))


def test_those_by_which_the_fewest_lie_come_first() -> None:
    assert [each.without for each in possible(bank_at(10.0, {}))] == ALONE


def test_a_hypothesis_that_is_refuted_is_told_as_such_until_it_is_no_longer_a_number() -> None:
    bank = bank_at(10.0, {})
    row = bank.rows.places[frozenset(("radar",))]
    alive = bank.alive.copy()
    alive[row] = False
    refuted = bank._replace(alive=alive)
    assert judgements(refuted)[("radar",)] == "refuted"
    x, P = bank.x.copy(), bank.P
    x[row, 1] = np.nan
    told: list[Possible] = possible(refuted.moved(joined(x, P)))
    assert [each.without for each in told] == [without for without in ALONE if without != ("radar",)]
