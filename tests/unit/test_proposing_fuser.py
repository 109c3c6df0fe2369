"""A fuser that proposes: when it begins again from what was voted."""

from __future__ import annotations

import pytest

from ballots import MS, T0, TOLERANCE, at, candidate
from milepost.nodes.base import Node, Output
from milepost.nodes.voting.candidate import CandidateNode
from milepost_schemas import Candidate, Feedback, Message

# a second
PATIENCE = 50


class Says(Node):
    """A fuser that says what it is told to; `begun_again`: from the feedbacks of these times."""

    def __init__(self) -> None:
        super().__init__("maglev-1", "fuser-2", "v1")
        self.next: Candidate | None = None
        self.begun_again: list[int] = []

    def tick(self, now_ns: int) -> list[Output]:
        assert self.next is not None
        assert self.next.feedback is not None
        return [Output("state", "", self.next.state), Output("feedback", "", self.next.feedback)]

    def catch_up(self, feedback: Feedback, now_ns: int) -> bool:
        self.begun_again.append(feedback.measured_at_ns)
        return True


def epochs_until_it_begins_again(off_m: float, awaited_every: int, epochs: int) -> int | None:
    """Of a fuser that is off by so much; the voted state awaits a unit in one epoch of so many."""
    inner = Says()
    node = CandidateNode(inner, TOLERANCE, 20 * MS)
    for number in range(epochs):
        now = at(number)
        inner.next = candidate("fuser-2", number, off_m, awaiting=[])
        awaiting = ["loop"] if awaited_every and number % awaited_every == 0 else []
        voted = candidate("voter", number, awaiting=awaiting)
        said: list[Message] = [output.message for output in node.tick(now)]
        assert [message.measured_at_ns for message in said] == [T0 + number * 20 * MS]
        for message in (voted.state, voted.feedback):
            assert message is not None
            list(node.step(message, now + MS))
        if inner.begun_again:
            return number + 1
    return None


def test_it_begins_again_after_a_second_of_contradiction() -> None:
    assert epochs_until_it_begins_again(0.5, 0, 200) == PATIENCE


@pytest.mark.parametrize("awaited_every", [2, 5, 30])
def test_an_epoch_of_which_the_two_heard_different_things_settles_nothing(awaited_every: int) -> None:
    """As on a busy machine: there 0.5 m is no contradiction, and no agreement either."""
    found = epochs_until_it_begins_again(0.5, awaited_every, 200)
    compared = PATIENCE * awaited_every / (awaited_every - 1)
    assert found == pytest.approx(compared, abs=2.0)


def test_one_that_agrees_never_begins_again() -> None:
    assert epochs_until_it_begins_again(0.0, 0, 3 * PATIENCE) is None
    assert epochs_until_it_begins_again(0.0, 5, 3 * PATIENCE) is None
