"""Which units may lie is told once a second, and agrees with the published states."""

from __future__ import annotations

from pathlib import Path

import pytest
from harness import MAGLEV, ROOT, Journey

from examples import write_train
from milepost.config.train import Train, load_train
from milepost.nodes.base import Output
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry
from milepost_schemas import FusedState, Hypotheses, Hypothesis

LIES_S, END_S = 10.0, 20.0


def told(train: Train, duration_s: float, *faults: FaultEntry) -> tuple[list[Hypotheses], dict[int, FusedState]]:
    """What a train says of its hypotheses, and its states by epoch."""
    journey, found = Journey(train), []

    def tap(output: Output, now_ns: int) -> None:
        journey.tap(output, now_ns)
        if isinstance(output.message, Hypotheses):
            found.append(output.message)

    simulate(train, duration_s, tap, journey.keep, None, list(faults))
    return found, {state.epoch: state for state in journey.live.values()}


def leading(message: Hypotheses) -> Hypothesis:
    (found,) = (each for each in message.hypotheses if each.judgement == "leads")
    return found


def test_what_leads_is_what_is_published_and_the_liar_is_the_difference() -> None:
    """GIVEN a radar that lies from 10 s on, WHEN the train is driven on, THEN once a second it is told what may be."""
    found, states = told(load_train(MAGLEV), END_S, FaultEntry(unit="radar", kind="bias", size=3.0, from_s=LIES_S))
    assert len(found) in (int(END_S), int(END_S) - 1, int(END_S) + 1)
    for message in found:
        state, leads = states[message.epoch], leading(message)
        assert (leads.position_m, leads.speed_mps) == (state.position_m, state.speed_mps)
        for each in message.hypotheses:
            if each.judgement in ("leads", "held"):
                assert state.position_min_m <= each.position_m <= state.position_max_m
                assert state.speed_min_mps <= each.speed_mps <= state.speed_max_mps
    assert leading(found[5]).without == []
    assert leading(found[-1]).without == ["radar"]


def test_a_rule_without_hypotheses_tells_none(tmp_path: Path) -> None:
    found, states = told(load_train(write_train(tmp_path, {"fusion.rule": "federated"})), 3.0)
    assert found == []
    assert states


@pytest.mark.parametrize("name", ["full", "metro"])
def test_each_unit_of_a_train_is_asked_about(name: str) -> None:
    train = load_train(ROOT / f"deploy/trains/{name}.yaml")
    found, _ = told(train, 5.0)
    alone = {each.without[0] for each in found[-1].hypotheses if len(each.without) == 1}
    assert alone >= set(train.sensors)
