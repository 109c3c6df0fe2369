"""Noise that is learned in the bank: by each hypothesis from what it believes, and kept as hypotheses come and go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from examples import T0
from milepost.estimation.filters import FILTERS
from milepost.estimation.layout import Layout
from milepost.estimation.observation import Observation
from milepost.estimation.time_units import NS_PER_S, S_PER_NS
from milepost.fusion.bank import BankKernel
from milepost.fusion.bank_state import Bank
from milepost.fusion.hypotheses import Doubts, Suspect
from milepost.sensors.observed import Stacked

MEAN, COVARIANCE = np.array([0.0, 20.0, 0.0]), np.diag([1.0, 1.0, 0.01])
# in the order of their readings: the prior sits at the first one, which is of none that is left out
UNITS = ("v", "u", "w")
LEARNING = sorted(kind for kind, row in FILTERS.items() if row.learner(row.options_model()) is not None)


class Speed:
    """z = v + e, R = 0.01 as stated, which is learned as a kind of filter does."""

    pure = True

    def __init__(self, kind: str) -> None:
        row = FILTERS[kind]
        self.learner = row.learner(row.options_model())

    def start(self) -> None:
        """It remembers nothing."""

    restart = start

    def judge(self, memory: Any, reading: float, mean: Any, covariance: Any) -> Any:
        raise NotImplementedError

    def each(self, reading: float, beliefs: Any) -> list[Stacked]:
        return [Stacked((0.0, 1.0, 0.0), reading, 0.01)]


def bank_of(kind: str, units: tuple[str, ...] = UNITS, trusted: bool = False) -> BankKernel:
    doubts = Doubts(() if trusted else tuple(Suspect(unit, 1e-4, 10.0) for unit in units))
    return BankKernel(Layout(), 0.01, {unit: Speed(kind) for unit in units}, doubts, 5.0)


def said(units: tuple[str, ...], lie_mps: float = 0.0, from_s: float = 3.0, rate: float = 0.0) -> list[Observation]:
    """Ten readings a second for eight seconds with an error of 0.1 m/s, of u with a lie or a slow one beside it."""
    out = []
    for k in range(80):
        for order, unit in enumerate(units):
            rng = np.random.default_rng([k, *unit.encode()])
            t_s = 0.1 * k + 0.01 * UNITS.index(unit)
            lie = lie_mps + rate * (t_s - from_s) if unit == "u" and t_s >= from_s else 0.0
            at_ns = T0 + round(t_s * NS_PER_S)
            out.append(Observation(at_ns, order, k, "i", 0, unit, (), reading=20.0 + 0.1 * rng.normal() + lie))
    return out


def banks(kernel: BankKernel, observations: list[Observation]) -> Iterator[Bank]:
    bank, at_ns = kernel.prior(MEAN, COVARIANCE), observations[0].measured_at_ns
    for o in observations:
        bank, at_ns = kernel.take(kernel.advance(bank, (o.measured_at_ns - at_ns) * S_PER_NS), o), o.measured_at_ns
        yield bank


@pytest.mark.parametrize("kind", LEARNING)
def test_the_hypothesis_without_a_unit_learned_nothing_under_it(kind: str) -> None:
    others = ("v", "w")
    *_, with_u = banks(bank_of(kind), said(UNITS, rate=0.02))
    *_, without = banks(bank_of(kind, others), said(others))
    row = with_u.rows.places[frozenset("u")]
    assert with_u.x[row] == pytest.approx(without.x[0], rel=1e-9)
    for unit in others:
        for ours, theirs in zip(_leaves(with_u, unit, row), _leaves(without, unit, 0), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-6)


@pytest.mark.parametrize("kind", LEARNING)
def test_what_was_learned_survives_exclusion_and_readmission(kind: str) -> None:
    passing = [
        o._replace(reading=20.0) if o.unit == "u" and o.measured_at_ns > T0 + 4 * NS_PER_S else o for o in said(UNITS, 5.0)
    ]
    seen = list(banks(bank_of(kind), passing))
    assert {frozenset(), frozenset("u")} <= {bank.rows.excluded for bank in seen}
    assert seen[-1].rows.excluded == frozenset()
    for unit in UNITS:
        for bank in seen[3:]:
            assert all(len(part) in (1, len(bank.x)) for part in _arrays(bank, unit))


@pytest.mark.parametrize("kind", LEARNING)
def test_the_noise_of_a_trusted_unit_is_learned_too(kind: str) -> None:
    *_, bank = banks(bank_of(kind, trusted=True), said(UNITS))
    assert all(bank.verdicts[unit].noise for unit in UNITS)


@pytest.mark.parametrize("kind", LEARNING)
def test_rows_without_their_reading_count_as_they_come(kind: str) -> None:
    """They are of a filter that is not ours, or a stored calibration."""
    rows = [o._replace(reading=None, row=(0.0, 1.0, 0.0), value=o.reading, variance=0.01) for o in said(UNITS)]
    *_, learning = banks(bank_of(kind), rows)
    *_, plain = banks(bank_of("kalman"), rows)
    np.testing.assert_array_equal(learning.x, plain.x)
    assert not any(verdict.noise for verdict in learning.verdicts.values())


def _arrays(bank: Bank, unit: str) -> list[Any]:
    """The arrays of what was learned of a unit."""

    def parts(memory: Any) -> Iterator[Any]:
        for part in memory:
            yield from parts(part) if isinstance(part, tuple) else (part,)

    return [part for learned in bank.verdicts[unit].noise for part in parts(learned.memory)]


def _leaves(bank: Bank, unit: str, row: int) -> list[Any]:
    """What a row learned of a unit."""
    return [part[row if len(part) > 1 else 0] for part in _arrays(bank, unit)]
