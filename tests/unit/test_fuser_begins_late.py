"""A fuser that is started again while nobody remembers a fused state: the prior is that of the beginning."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from milepost.config.roles import fuser_settings
from milepost.config.train import load_train
from milepost.nodes.fuser import FuserNode
from milepost.offline.run import simulate
from milepost_schemas import FusedState, Truth
from milepost_schemas.state import SAYS_NOTHING


class Heard:
    """What the fusers of a train heard in its first seconds, and where it was."""

    def __init__(self, name: str) -> None:
        self.train = load_train(Path(f"deploy/trains/{name}.yaml"))
        self.messages, self.truths = [], {}

        def listen(output, now_ns):
            if output.stream in ("estimate", "fix"):
                self.messages.append((output.message, now_ns))
            elif isinstance(output.message, Truth):
                self.truths[output.message.measured_at_ns] = output.message

        simulate(self.train, 6.0, listen)
        self.start_ns = min(self.truths)

    def states(self, from_s: float, told: bool) -> Iterator[FusedState]:
        """The states of a fuser that hears nothing until then."""
        fuser = FuserNode(self.train.name, "again", fuser_settings(self.train), self.train.line)
        if told:
            fuser.began(self.start_ns)
        for message, now_ns in self.messages:
            if now_ns - self.start_ns >= from_s * 1e9:
                yield from (out.message for out in fuser.step(message, now_ns) if out.stream == "state")

    def outside(self, states: list[FusedState]) -> int:
        """How many of these are of an interval that does not hold the truth."""
        there = [(state, self.truths[state.measured_at_ns]) for state in states if state.measured_at_ns in self.truths]
        assert there
        return sum(not state.position_min_m <= truth.position_m <= state.position_max_m for state, truth in there)


@pytest.fixture(scope="module", params=["full", "metro", "maglev"])
def heard(request) -> Heard:
    return Heard(request.param)


@pytest.mark.parametrize("from_s", [0.8, 1.5, 3.0])
def test_a_fuser_that_begins_late_holds_the_truth(heard, from_s):
    """GIVEN all fusers died before the first state WHEN one is back a second later THEN the truth is inside."""
    states = list(heard.states(from_s, told=True))
    assert heard.outside(states) == 0
    assert {unit.kind for state in states for unit in state.excluded} <= SAYS_NOTHING


def test_a_fuser_that_begins_at_the_beginning_is_not_changed_by_knowing_it(heard):
    told, untold = (list(heard.states(0.0, told)) for told in (True, False))
    assert told == untold
