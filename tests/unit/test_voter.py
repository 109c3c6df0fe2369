"""Two out of three, by hand."""

from __future__ import annotations

from typing import Any

import pytest

from ballots import NAMES, STATE, TOLERANCE, at, candidate, voter
from examples import GAUSSIAN
from milepost.nodes.base import Output
from milepost.nodes.voting.agreement import difference
from milepost.nodes.voting.voter import VoterNode
from milepost_schemas import Candidate, Event, Feedback, FusedState, SensorExcluded


def say(node: VoterNode, unit: str, epoch: int, off_m: float = 0.0, later_ms: float = 5.0, **changed: Any) -> list[Output]:
    return list(node.step(candidate(unit, epoch, off_m, **changed), at(epoch, later_ms)))


def states(outputs: list[Output]) -> list[FusedState]:
    return [o.message for o in outputs if isinstance(o.message, FusedState)]


def codes(outputs: list[Output]) -> list[str]:
    return [o.message.code for o in outputs if isinstance(o.message, Event)]


def epochs(node: VoterNode, first: int, last: int, off_m: float, liar: str = "fuser-2") -> list[Output]:
    """All three speak in every epoch; one of them is off."""
    return [o for n in range(first, last) for unit in NAMES for o in say(node, unit, n, off_m if unit == liar else 0.0)]


def test_an_epoch_is_published_as_soon_as_two_agree_and_once() -> None:
    node = voter()
    assert say(node, "fuser-3", 0) == []
    out = say(node, "fuser-2", 0)
    assert [o.stream for o in out] == ["state", "feedback"]
    assert say(node, "fuser", 0) == []


def test_what_is_published_says_that_the_voter_said_it() -> None:
    node = voter()
    found = [state for n in range(3) for unit in NAMES for state in states(say(node, unit, n))]
    assert [(s.unit, s.instance, s.sequence) for s in found] == [("voter", "v1", n) for n in range(3)]
    assert found[0].published_at_ns == at(0)


def test_of_two_that_agree_the_earlier_in_the_list_is_published() -> None:
    node = voter()
    say(node, "fuser-3", 0, 0.01)
    (state,) = states(say(node, "fuser-2", 0, 0.02))
    assert state.position_m == STATE.position_m + 0.02


def test_the_outer_ends_of_both_intervals_are_published() -> None:
    node = voter()
    say(node, "fuser", 0, position_min_m=STATE.position_min_m + 0.5, speed_max_mps=STATE.speed_max_mps + 0.25)
    out = say(node, "fuser-2", 0, position_max_m=STATE.position_max_m + 0.5)
    for message in (o.message for o in out):
        assert isinstance(message, FusedState | Feedback)
        assert message.position_min_m == STATE.position_min_m
        assert message.position_max_m == STATE.position_max_m + 0.5
        assert message.speed_max_mps == STATE.speed_max_mps + 0.25


LESS = {
    "awaiting": [*STATE.awaiting, "late"],
    "sensors": STATE.sensors[1:],
    "position_m": STATE.position_m + 0.3,
    "speed_mps": STATE.speed_mps + 0.1,
    "position_max_m": STATE.position_max_m + 2.0,
    "covariance": [[4.0 * number for number in row] for row in STATE.covariance],
}


def test_one_that_has_not_heard_a_unit_in_time_agrees_where_the_other_estimate_lies_in_its_interval() -> None:
    """On a busy machine a reading comes in time to one fuser and not to the other: neither is wrong."""
    node = voter()
    say(node, "fuser", 0, **LESS)
    (state,) = states(say(node, "fuser-2", 0))
    assert state.position_m == STATE.position_m, "the one that has heard more speaks"
    assert state.position_max_m == LESS["position_max_m"], "the interval holds what the other one says"


def test_one_that_has_not_heard_a_unit_is_outvoted_where_an_estimate_lies_outside() -> None:
    node = voter()
    outside = {**LESS, "position_m": STATE.position_max_m + 0.1}
    out = [o for n in range(3) for unit in NAMES for o in say(node, unit, n, **(outside if unit == "fuser-2" else {}))]
    assert [s.position_m for s in states(out)] == [STATE.position_m] * 3
    assert codes(out) == ["fuser_outvoted"]


def test_one_missing_is_no_hindrance_and_is_named_after_three_epochs() -> None:
    node, out = voter(), []
    for n in range(3):
        out += [*say(node, "fuser", n), *say(node, "fuser-3", n)]
        assert codes(out) == []
        out += node.tick(at(n, 105.0))
    assert len(states(out)) == 3
    (event,) = [o.message for o in out if o.stream == "event"]
    assert (event.code, event.text.split(":")[0]) == ("fuser_missing", "fuser-2")


def test_one_that_differs_is_outvoted_and_named_after_three_epochs() -> None:
    node = voter()
    out = epochs(node, 0, 3, 0.2)
    assert [s.position_m for s in states(out)] == [STATE.position_m] * 3
    (event,) = [o.message for o in out if o.stream == "event"]
    assert (event.code, event.severity) == ("fuser_outvoted", "error")
    assert event.text.startswith("fuser-2: outvoted in 3 epochs in a row (position_m differs by 0.2)")


def test_two_epochs_that_differ_name_nobody() -> None:
    node = voter()
    assert codes(epochs(node, 0, 2, 0.2) + epochs(node, 2, 5, 0.0) + epochs(node, 5, 7, 0.2)) == []


def without(node: VoterNode, first: int, last: int, silent: str) -> list[Output]:
    """Two of the three speak in every epoch, and each epoch is closed."""
    out: list[Output] = []
    for n in range(first, last):
        out += [output for unit in NAMES if unit != silent for output in say(node, unit, n)]
        out += node.tick(at(n, 105.0))
    return out


def test_a_fuser_that_was_only_late_has_a_vote_again_after_three_epochs() -> None:
    """A stall is no lie. Where another fuser is wrong right after it, two must be left to vote."""
    node = voter()
    assert codes(without(node, 0, 3, "fuser-3")) == ["fuser_missing"]
    assert codes(epochs(node, 3, 5, 0.0)) == []
    assert codes(epochs(node, 5, 6, 0.0)) == ["fuser_readmitted"]
    out = epochs(node, 6, 9, 0.2)
    assert len(states(out)) == 3
    assert codes(out) == ["fuser_outvoted"]


def test_a_fuser_that_comes_back_with_something_else_has_no_vote_until_it_agreed_for_the_stated_time() -> None:
    node = voter()
    without(node, 0, 3, "fuser-2")
    assert codes(epochs(node, 3, 4, 0.2) + epochs(node, 4, 53, 0.0)) == []
    assert codes(epochs(node, 53, 54, 0.0)) == ["fuser_readmitted"]


def test_an_outvoted_fuser_has_no_vote_until_it_agreed_for_the_stated_time() -> None:
    node = voter()
    epochs(node, 0, 3, 0.2)
    # now it agrees with fuser, but its word does not count yet
    assert states(say(node, "fuser", 3) + say(node, "fuser-2", 3)) == []
    assert len(states(say(node, "fuser-3", 3))) == 1
    out = epochs(node, 4, 52, 0.0)
    assert codes(out) == []
    assert codes(epochs(node, 52, 53, 0.0)) == ["fuser_readmitted"]
    assert len(states(say(node, "fuser", 53) + say(node, "fuser-2", 53))) == 1


def test_an_outvoted_fuser_that_differs_once_more_begins_again() -> None:
    node = voter()
    epochs(node, 0, 3, 0.2)
    out = epochs(node, 3, 40, 0.0) + epochs(node, 40, 41, 0.2) + epochs(node, 41, 90, 0.0)
    assert codes(out) == []
    assert codes(epochs(node, 90, 91, 0.0)) == ["fuser_readmitted"]


def test_one_that_is_out_replaces_one_that_is_gone() -> None:
    """Out of three one was outvoted, then another one died: the first has a vote again when it agreed with the last."""
    node = voter()
    epochs(node, 0, 3, 0.2)
    out: list[Output] = []
    for n in range(3, 60):
        out += [*say(node, "fuser", n), *say(node, "fuser-2", n), *node.tick(at(n, 105.0))]
    assert codes(out) == ["no_majority", "fuser_readmitted", "majority_again", "fuser_missing"]
    assert len(states(out)) == 60 - 53


def test_where_all_three_differ_nothing_is_published_and_an_event_says_so_once() -> None:
    node = voter()
    out = epochs(node, 0, 2, 0.0)
    for n in (2, 3):
        for k, unit in enumerate(NAMES):
            out += say(node, unit, n, 0.2 * k)
    assert len(states(out)) == 2
    assert codes(out) == ["no_majority"]
    again = epochs(node, 4, 6, 0.0)
    assert codes(again) == ["majority_again"]
    assert "2 epochs" in next(o.message.text for o in again if isinstance(o.message, Event))


def test_a_tie_of_two_waits_for_the_third() -> None:
    node = voter()
    assert states(say(node, "fuser", 0) + say(node, "fuser-2", 0, 0.2)) == []
    assert node.next_tick_ns() == at(0, 105.0)
    (state,) = states(say(node, "fuser-3", 0, 0.2, later_ms=90.0))
    assert state.position_m == STATE.position_m + 0.2


def test_after_the_deadline_an_epoch_is_not_published() -> None:
    node = voter()
    epochs(node, 0, 1, 0.0)
    say(node, "fuser", 1)
    out = list(node.tick(at(1, 105.0)))
    assert codes(out) == ["no_majority"]
    late = say(node, "fuser-3", 1, later_ms=106.0)
    assert states(late) == []
    assert node.refusals.counts == {"too_late": 1}


def test_where_all_are_late_alike_they_are_heard() -> None:
    """The deadline counts from the first candidate: a machine that stalled is no reason to say nothing."""
    node = voter()
    out = [o for unit in NAMES for o in say(node, unit, 0, later_ms=500.0)]
    assert len(states(out)) == 1


def test_a_fuser_that_is_ahead_of_time_ends_no_vote_early() -> None:
    node = voter()
    epochs(node, 0, 1, 0.0)
    list(node.step(candidate("fuser-2", 20), at(1)))
    assert list(node.tick(at(10))) == []
    assert len(states(say(node, "fuser", 20) + say(node, "fuser-3", 20))) == 1


def test_no_epoch_is_published_after_a_later_one() -> None:
    node = voter()
    say(node, "fuser", 0)
    assert len(states(say(node, "fuser", 1) + say(node, "fuser-2", 1))) == 1
    assert states(say(node, "fuser-3", 0, later_ms=40.0)) == []


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (candidate("fuser-4", 1), "unknown_unit"),
        (candidate("fuser", 1, epoch=7), "off_grid"),
        (candidate("fuser", 40), "from_future"),
        (candidate("fuser", -60), "too_late"),
        (candidate("fuser-2", 1), "duplicate"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_be_voted_on_is_refused(message: Candidate, reason: str) -> None:
    node = voter()
    say(node, "fuser-2", 1)
    assert codes(list(node.step(message, at(1)))) == [f"refused_{reason}"]


def test_a_restarted_voter_publishes_nothing_twice_and_remembers_what_was_voted() -> None:
    node = voter()
    last = candidate("fuser", 5).feedback
    assert last is not None
    assert node.catch_up(last, at(5))
    assert states(epochs(node, 4, 6, 0.0)) == []
    assert len(states(epochs(node, 6, 7, 0.0))) == 1
    answer = node.answer("latest_feedback")
    assert isinstance(answer, Feedback)
    assert (answer.unit, answer.measured_at_ns) == ("voter", at(6, 0.0))


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"position_max_m": STATE.position_max_m + 1.1}, "position_max_m"),
        ({"position_max_m": STATE.position_max_m + 0.9}, None),
        ({"speed_mps": STATE.speed_mps - 0.03}, "speed_mps"),
        ({"speed_min_mps": STATE.speed_min_mps - 0.01}, None),
        ({"status": "degraded"}, "status"),
        ({"line_hash": "f" * 16}, "line_hash"),
        ({"latitude_deg": STATE.latitude_deg + 1e-6}, "latitude_deg"),  # type: ignore[operator]
        ({"latitude_deg": None}, "latitude_deg"),
        ({"covariance": [[8.0, 0.5, 0.0], [0.5, 1.0, 0.1], [0.0, 0.1, 0.25]]}, "covariance"),
        ({"last_balise": None}, None),
        ({"awaiting": []}, None),
        ({"doubted": []}, "doubted loop, radar and none"),
        ({"excluded": [SensorExcluded(unit="radar", reason="biased", kind="biased")]}, "excluded none and radar"),
        # that nothing is heard of a unit one may have seen and the other not
        ({"excluded": []}, None),
        ({"position_accuracy_m": float("nan")}, "position_accuracy_m"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_agreement_is_on_numbers_status_line_and_who_is_wrong(changed: dict[str, Any], word: str | None) -> None:
    found = difference(candidate("fuser", 0), candidate("fuser-2", 0, **changed), TOLERANCE)
    assert found is None if word is None else found is not None and found.startswith(word)


def test_agreement_is_on_every_state_that_is_fed_back() -> None:
    one, other = candidate("fuser", 0), candidate("fuser-2", 0)
    assert other.feedback is not None
    mean = [*GAUSSIAN.mean[:3], GAUSSIAN.mean[3] + 0.0003]
    fused = GAUSSIAN.model_copy(update={"mean": mean})
    other = other.model_copy(update={"feedback": other.feedback.model_copy(update={"fused": fused})})
    assert str(difference(one, other, TOLERANCE)).startswith("feedback radar.scale")
    alone = one.model_copy(update={"feedback": None})
    assert difference(one, alone, TOLERANCE) == "feedback of one alone"
