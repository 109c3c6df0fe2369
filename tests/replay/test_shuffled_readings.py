"""Readings of sensors that look at the belief, late by up to two seconds and out of order, settle to the same states."""

from __future__ import annotations

import random
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from milepost.config.train import Train, load_train
from milepost.estimation.filters import FILTERS
from milepost.estimation.filters.learning import LearningFilter
from milepost.nodes.base import Output
from milepost.offline.run import replay, simulate
from milepost_schemas import FusedState, Message

ROOT = Path(__file__).resolve().parents[2]
LATEST_NS = 2_000_000_000
LEARNING = [kind for kind, row in FILTERS.items() if issubclass(row, LearningFilter)]
Received = tuple[str, str, Message, int]
# every wheel of the metro spins, and slides within the run; the full train spins one
SPIN: dict[str, Any] = {"world": {"creep": {"events": [{"from_s": 6.0, "to_s": 9.0, "ratio": 0.15}]}}}
TRAINS = {
    "metro": (SPIN, 16.0),
    "full": ({"world": {"creep": {"events": [{"from_s": 2.0, "to_s": 4.0, "ratio": -0.3}]}}}, 7.0),
}


def readings_of(train: Train, duration_s: float) -> list[Received]:
    """All readings of a simulated run, with the times of their receipt."""
    out: list[Received] = []

    def tap(output: Output, now_ns: int) -> None:
        if output.stream.endswith("_reading") or output.stream == "balise_telegram":
            out.append((output.stream, output.unit, output.message, now_ns))

    simulate(train, duration_s, tap)
    return out


def settled(train: Train, messages: Iterable[Received]) -> list[FusedState]:
    states: list[FusedState] = []
    replay(train, messages, False, states.append)
    return states


def what_is_believed(state: FusedState) -> dict[str, Any]:
    """Everything but the shares: these go by what the filters said of their readings when they came."""
    return state.model_dump(exclude={"sensors": {"__all__": {"share"}}})


@pytest.mark.slow
@pytest.mark.parametrize("name", TRAINS)
def test_shuffled_readings_settle_to_the_same_bits(name: str) -> None:
    change, duration_s = TRAINS[name]
    train = load_train(ROOT / f"deploy/trains/{name}.yaml", change)
    recorded = readings_of(train, duration_s)
    in_order = settled(train, recorded)
    reasons = {excluded.reason for state in in_order for excluded in state.excluded}
    assert reasons & {"spinning", "sliding"}, "no wheel slipped: this would prove nothing"
    for seed in (1, 2):
        rng = random.Random(seed)
        late = [(*message[:3], message[3] + int(rng.random() * LATEST_NS)) for message in recorded]
        late += rng.sample(late, len(late) // 20)
        shuffled = settled(train, sorted(late, key=lambda message: message[3]))
        assert [what_is_believed(s) for s in shuffled] == [what_is_believed(s) for s in in_order]


@pytest.mark.parametrize("kind", LEARNING)
def test_readings_whose_noise_is_learned_settle_to_the_same_bits(kind: str) -> None:
    learning = {"units": {unit: {"filter": kind} for unit in ("radar", "loop")}}
    plain, train = (load_train(ROOT / "deploy/trains/maglev.yaml", change) for change in ({}, learning))
    recorded = readings_of(train, 2.5)
    in_order = settled(train, recorded)
    assert in_order[-1].position_m != settled(plain, recorded)[-1].position_m
    rng = random.Random(3)
    late = [(*message[:3], message[3] + int(rng.random() * 0.2 * LATEST_NS)) for message in recorded]
    shuffled = settled(train, sorted(late, key=lambda message: message[3]))
    assert [what_is_believed(s) for s in shuffled] == [what_is_believed(s) for s in in_order]
