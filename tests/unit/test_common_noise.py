"""Noise that is in row 0 too refutes no other explanation: a hard brake must not end the doubt about a liar."""

from __future__ import annotations

import numpy as np
import pytest

from banks import Ride, receiver, speedometer
from milepost.fusion.bank_state import Bank, Channel
from milepost.fusion.finding import Finding
from milepost.fusion.hypotheses import NOBODY
from milepost.fusion.isolation import SOFT, Isolation

TRAIN = Ride((speedometer("first"), speedometer("second"), receiver()))
RECEIVER = frozenset({"receiver"})


def decided(row_0: float, other: float) -> tuple[Bank, Bank]:
    """The bank before and after a reading of `first`, so many limits off in row 0, and in the row without the receiver."""
    before = next(iter(TRAIN.moments(1.0))).bank
    limit, H = TRAIN.doubts().threshold, len(before.rows.sets)
    off = np.zeros(H)
    off[0], off[before.rows.places[RECEIVER]] = row_0 * limit, other * limit
    place = Isolation(TRAIN.layout, TRAIN.doubts()).channel("first")
    channel = Channel.begin(H)
    channel = channel._replace(sums=np.vstack([off, np.zeros((len(channel.sums) - 1, H))]), readings=1, nu=off)
    state = before.tested(before.x, before.P, place, channel)
    finding = Finding("first", 1, before.rows.uses("first"), channel, None)
    return before, TRAIN.kernel()._isolation.decide(before, state, finding)


def test_a_row_that_a_reading_tells_against_alone_is_refuted() -> None:
    before, after = decided(0.5 * SOFT, 1.01)
    assert before.alive.all()
    assert [units for units, lives in zip(after.rows.sets, after.alive, strict=True) if not lives] == [RECEIVER]


@pytest.mark.parametrize("row_0", [SOFT + 0.01, 0.99])
def test_a_row_is_not_refuted_by_a_reading_that_nearly_refutes_row_0_too(row_0: float) -> None:
    assert decided(row_0, 1.01)[1].alive.all()


def test_a_reading_that_refutes_row_0_as_well_refutes_both() -> None:
    after = decided(1.2, 1.2)[1]
    assert {units for units, lives in zip(after.rows.sets, after.alive, strict=True) if not lives} == {NOBODY, RECEIVER}
