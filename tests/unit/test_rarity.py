"""How rare by noise alone the tests of the leading hypothesis are."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from banks import Fault, Ride, between, bias, noisy, reader, receiver, speedometer
from milepost.fusion.bank_state import RAREST, Channel, by_chance, rarity


@pytest.mark.parametrize("fault", [bias(0.15), noisy(1.6)])
def test_the_power_of_ten_is_that_of_the_probability_itself(fault: Fault) -> None:
    """Most often no test is worse than nine in ten are by chance, which is all that is looked at."""
    ride = Ride([speedometer("radar"), speedometer("radar-2", phase_s=0.02), receiver(), reader()])
    found: Counter[int] = Counter()
    for moment in ride.moments(40.0, {"radar": between(10.0, 30.0, fault)}):
        bank = moment.bank
        chance = by_chance(bank)[bank.leader]
        assert rarity(bank) == int(-math.log10(max(chance, 10.0**-RAREST)))
        found[rarity(bank)] += 1
    assert found[0] > 0.5 * found.total()
    assert max(found) >= 2


def test_nothing_heard_is_not_rare() -> None:
    ride = Ride([speedometer("radar")])
    bank = next(ride.moments(1.0)).bank
    assert rarity(bank._replace(channels=(Channel.begin(len(bank.alive)),) * len(bank.channels))) == 0
