"""What learners of noise keep to, so that each hypothesis of the bank may have a memory of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from learners import seen
from milepost.estimation.filters import FILTERS
from milepost.estimation.noise.learner import Learned, Learner, Seen, continued, learned
from milepost.estimation.time_units import NS_PER_S

LEARNING = sorted(kind for kind, row in FILTERS.items() if row.learner(row.options_model()) is not None)
BELIEFS = 3


def learner_of(kind: str) -> Learner:
    row = FILTERS[kind]
    learner = row.learner(row.options_model())
    assert learner is not None
    return learner


def series(count: int) -> list[Seen]:
    """Readings whose linearised values and innovations differ from belief to belief."""
    rng = np.random.default_rng(3)
    away = np.array([0.0, 2.0, -5.0])
    return [
        seen(4.0 * k + away + 3.0 * rng.normal(), np.ones(BELIEFS), 3.0 * rng.normal() + away, [0.1, 0.2, 0.5])
        for k in range(count)
    ]


def fed(learner: Learner, readings: list[Seen], last: Learned | None = None) -> tuple[list[np.ndarray], Learned]:
    begin, out = 0 if last is None else last.at_ns // NS_PER_S + 1, []
    for k, reading in enumerate(readings, start=begin):
        judged, last = learned(learner, last, k * NS_PER_S, reading)
        out.append(np.stack(np.broadcast_arrays(*judged)))
    assert last is not None
    return out, last


@pytest.mark.parametrize("kind", LEARNING)
def test_each_belief_learns_as_if_it_were_the_only_one(kind: str) -> None:
    readings = series(60)
    together, _ = fed(learner_of(kind), readings)
    for i in range(BELIEFS):
        alone, _ = fed(learner_of(kind), [Seen(*(part[i : i + 1] for part in reading)) for reading in readings])
        for a, b in zip(alone, together, strict=True):
            np.testing.assert_allclose(a[:, 0], b[:, i], rtol=1e-9)


@pytest.mark.parametrize("kind", LEARNING)
def test_an_earlier_memory_continues_as_it_did(kind: str) -> None:
    learner, readings = learner_of(kind), series(60)
    _, early = fed(learner, readings[:30])
    first, _ = fed(learner, readings[30:], early)
    again, _ = fed(learner, readings[30:], early)
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("kind", LEARNING)
def test_beliefs_taken_over_continue_with_what_they_learned(kind: str) -> None:
    learner, readings, index = learner_of(kind), series(60), [2, 0, 0, 2]
    straight, early = fed(learner, readings)[0], fed(learner, readings[:30])[1]
    taken_over = early._replace(memory=continued(early.memory, index))
    other, _ = fed(learner, [Seen(*(part[index] for part in reading)) for reading in readings[30:]], taken_over)
    for a, b in zip(other, straight[30:], strict=True):
        np.testing.assert_allclose(a, b[:, index], rtol=1e-9)


@pytest.mark.parametrize("kind", LEARNING)
def test_a_belief_without_the_row_learns_nothing_from_it(kind: str) -> None:
    learner, readings = learner_of(kind), series(30)
    _, before = fed(learner, readings)
    absent = np.array([False, True, False])
    judged, after = learned(learner, before, before.at_ns, seen(1e3, 7.0, [1e3] * BELIEFS, 0.1), absent)
    value, variance = np.broadcast_arrays(*judged)
    assert (value[1], variance[1]) == (1e3, 7.0)
    same = [np.array_equal(a, b) for a, b in zip(_leaves(before.memory), _leaves(after.memory), strict=True)]
    assert all(same[1::BELIEFS])
    assert not all(same[0::BELIEFS])


@pytest.mark.parametrize("kind", LEARNING)
@pytest.mark.parametrize("wild", [1e200, -1e300, math.inf])
def test_where_the_arithmetic_fails_a_reading_counts_as_stated(kind: str, wild: float) -> None:
    learner, readings = learner_of(kind), series(30)
    _, before = fed(learner, readings)
    _, after = learned(learner, before, before.at_ns + NS_PER_S, seen(wild, 1.0, [wild] * BELIEFS, 0.1))
    judged, _ = learned(learner, after, before.at_ns + 2 * NS_PER_S, readings[-1])
    assert np.all(np.isfinite(judged.value))
    assert np.all(judged.variance > 0.0)
    assert np.all(np.isfinite(judged.variance))


def _leaves(memory: object) -> list[np.ndarray]:
    """The parts of a memory, belief by belief."""
    if isinstance(memory, tuple):
        return [leaf for part in memory for leaf in _leaves(part)]
    assert isinstance(memory, np.ndarray)
    return list(np.broadcast_to(memory, (BELIEFS, *memory.shape[1:])))
