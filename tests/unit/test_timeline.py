"""What a timeline takes, refuses, rewinds, forgets."""

from __future__ import annotations

import numpy as np
import pytest

from milepost.estimation.estimator import Estimator, Prior
from milepost.estimation.late import AT_ONCE
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.observation import FUTURE_NS, Observation
from milepost.estimation.time_units import NS_PER_S
from milepost.estimation.timeline import Timeline
from milepost.fusion.integrity import interval

T0 = 100 * NS_PER_S
SECOND = 5 * NS_PER_S
PRIOR = Prior(np.array([0.0, 20.0, 0.0]), np.array([1.0, 1.0, 0.1]))


def speed(t_s: float, sequence: int, value: float = 20.0, unit: str = "u", order: int = 0, instance: str = "i") -> Observation:
    return Observation(T0 + round(t_s * NS_PER_S), order, sequence, instance, 0, unit, (0.0, 1.0, 0.0), value, 0.04)


def estimator(**kwargs) -> Estimator:
    return Estimator(Layout(), 1e-3, PRIOR, SECOND, **kwargs)


class Log:
    """A kernel whose state is the list of what was done to it: shows order and work."""

    def __init__(self) -> None:
        self.work = 0

    def advance(self, state, dt_s):
        return [*state, f"+{dt_s:g}"]

    def take(self, state, observation):
        self.work += 1
        return [*state, observation.value]


def test_observations_are_taken_in_order_of_time_then_row_then_component():
    timeline = Timeline(Log(), [], SECOND)
    for o in (
        speed(2.0, 9, 4.0, unit="v", order=1),
        speed(1.0, 3, 3.0, unit="v", order=1)._replace(component=1),
        speed(1.0, 3, 2.0, unit="v", order=1),
        speed(1.0, 8, 1.0, order=0),
    ):
        assert timeline.insert(o, T0 + 2 * NS_PER_S) is None
    assert timeline.state_at(T0 + 3 * NS_PER_S) == [1.0, 2.0, 3.0, "+1", 4.0, "+1"]


def test_a_late_observation_replays_only_what_follows_it():
    kernel = Log()
    timeline = Timeline(kernel, [], SECOND)
    for i in range(10):
        timeline.insert(speed(0.1 * i, i), T0 + NS_PER_S)
    timeline.state_at(T0 + NS_PER_S)
    assert kernel.work == 10
    timeline.insert(speed(0.75, 99), T0 + NS_PER_S)
    timeline.state_at(T0 + NS_PER_S)
    assert kernel.work == 13
    assert (timeline.counters.rewinds, timeline.counters.replayed) == (1, 2)


class Counted:
    """A kernel whose state is the numbers of those taken, in order, and that counts its work."""

    def __init__(self) -> None:
        self.work = 0

    def advance(self, state, dt_s):
        return state

    def take(self, state, observation):
        self.work += 1
        return (*state[-800:], (observation.unit, observation.sequence))


def two_units(late_s: float, for_s: float = 12.0):
    """Two units at 100 Hz, the readings of one `late_s` late: what came when, in order."""
    came = [(0.01 * i, speed(0.01 * i, i, unit="a")) for i in range(round(100 * for_s))]
    came += [(0.01 * i + late_s, speed(0.01 * i + 0.005, i, unit="b", order=1)) for i in range(round(100 * (for_s - late_s)))]
    return sorted(came, key=lambda each: each[0])


@pytest.mark.parametrize("late_s", [0.02, 0.2, 1.0, 3.0, 4.9])
def test_a_unit_that_is_always_late_costs_no_more_the_later_it_is(late_s: float):
    """GIVEN two units at 100 Hz, one of them late, WHEN 50 live states a second are asked for, THEN they stay affordable.

    Three seconds late it cost 300 times the work, and the live states of a train fell behind for as long.
    """
    kernel, came = Counted(), two_units(late_s)
    timeline, asked_s = Timeline(kernel, (), SECOND), 0.0
    for now_s, observation in came:
        while asked_s <= now_s:
            timeline.advance_to(T0 + round(asked_s * NS_PER_S))
            timeline.live_at(T0 + round(asked_s * NS_PER_S), 8)
            asked_s += 0.02
        assert timeline.insert(observation, T0 + round(now_s * NS_PER_S)) is None
    assert kernel.work <= 8 * len(came)


@pytest.mark.parametrize("late_s", [0.2, 3.0])
def test_what_waits_is_in_every_state_that_is_not_live(late_s: float):
    ordered, timeline = Timeline(Counted(), (), SECOND), Timeline(Counted(), (), SECOND)
    end_ns = 0
    for now_s, observation in two_units(late_s, 8.0):
        end_ns = T0 + round(now_s * NS_PER_S)
        timeline.live_at(end_ns, 8)
        timeline.insert(observation, end_ns)
        if observation.sequence % 50 == 7:
            # what is asked for between does not matter
            timeline.state_at(end_ns - NS_PER_S)
    for _, observation in sorted(two_units(late_s, 8.0), key=lambda each: each[1].measured_at_ns):
        ordered.insert(observation, observation.measured_at_ns)
    for back_s in (4.0, 2.0, 0.0):
        at_ns = end_ns - round(back_s * NS_PER_S)
        assert timeline.state_at(at_ns) == ordered.state_at(at_ns)


def test_of_several_that_wait_the_least_stays_whichever_came_first():
    states = []
    for values in ((20.0, 21.0), (21.0, 20.0)):
        timeline = Timeline(Log(), [], SECOND)
        for i in range(200):
            timeline.insert(speed(0.01 * i, i, unit="a"), T0 + round(0.01 * i * NS_PER_S))
        timeline.live_at(T0 + 2 * NS_PER_S, 8)
        reasons = [timeline.insert(speed(0.5, 1, value, "b", 1), T0 + 2 * NS_PER_S) for value in values]
        assert reasons == [None, "duplicate"]
        assert 20.0 in timeline.live_at(T0 + 2 * NS_PER_S, 8)
        states.append(timeline.state_at(T0 + 2 * NS_PER_S))
    assert states[0] == states[1]


def after_three_seconds() -> tuple[Counted, Timeline, int]:
    """A timeline that has heard unit a a hundred times a second, its kernel, and the time of its live state."""
    kernel, now_ns = Counted(), T0 + 3 * NS_PER_S
    timeline = Timeline(kernel, (), SECOND)
    for i in range(300):
        timeline.insert(speed(0.01 * i, i, unit="a"), T0 + round(0.01 * i * NS_PER_S))
    timeline.live_at(now_ns, 8)
    return kernel, timeline, now_ns


def test_what_an_interruption_kept_back_is_soon_in_the_live_state():
    """GIVEN readings of two seconds that come at once WHEN they have come THEN a second later they count; no state waits."""
    kernel, timeline, now_ns = after_three_seconds()
    for i in range(100, 300):
        timeline.insert(speed(0.01 * i + 0.005, i, unit="b", order=1), now_ns)
    counts, work = [], []
    for _ in range(60):
        before, now_ns = kernel.work, now_ns + 20_000_000
        timeline.advance_to(now_ns)
        counts.append(sum(unit == "b" for unit, _ in timeline.live_at(now_ns, 8)))
        work.append(kernel.work - before)
    assert counts[0] < 50
    assert counts[-1] == 200
    assert max(work[1:]) <= 60


def test_what_an_interruption_kept_back_costs_no_more_where_it_comes_bit_by_bit():
    """GIVEN readings of two seconds that come within a quarter WHEN live states are asked for THEN none computes for them.

    For each that came while others were taken in, the next state computed two beliefs more: 0.1 s at once.
    """
    kernel, timeline, now_ns = after_three_seconds()
    counts, work = [], []
    for epoch in range(75):
        now_ns += 20_000_000
        for i in range(100 + 16 * epoch, min(300, 116 + 16 * epoch)):
            timeline.insert(speed(0.01 * i + 0.005, i, unit="b", order=1), now_ns)
        for i in (300 + 2 * epoch, 301 + 2 * epoch):
            timeline.insert(speed(0.01 * i, i, unit="a"), now_ns)
        before = kernel.work
        timeline.advance_to(now_ns)
        counts.append(sum(unit == "b" for unit, _ in timeline.live_at(now_ns, 8)))
        work.append(kernel.work - before)
    assert counts[-1] == 200
    # 8, two for each of the two that came in time, and those two in the chain without the late ones; but for the last of the
    # two seconds, which are late by less than what is taken in at once
    assert sorted(work)[-3] <= 8 + 2 * 2 + 2
    assert max(work) <= 8 + 2 * (2 + 16) + AT_ONCE


def test_what_is_handed_over_while_a_unit_is_late_holds_up_no_live_state():
    """GIVEN a unit three seconds late, whose readings wait WHEN all that is known is handed over THEN no state costs more."""
    kernel, came = Counted(), two_units(3.0, 8.0)
    timeline, asked_s, work = Timeline(kernel, (), SECOND), 0.0, []
    for i, (now_s, observation) in enumerate(came):
        if i % 10 == 0:
            timeline.kept()
        while asked_s <= now_s:
            timeline.advance_to(T0 + round(asked_s * NS_PER_S))
            before = kernel.work
            timeline.live_at(T0 + round(asked_s * NS_PER_S), 8)
            work.append(kernel.work - before)
            asked_s += 0.02
        timeline.insert(observation, T0 + round(now_s * NS_PER_S))
    assert max(work) <= 60


def test_a_state_at_a_time_adds_no_knot():
    kernel = Log()
    timeline = Timeline(kernel, [], SECOND)
    timeline.insert(speed(0.0, 0), T0)
    first = timeline.state_at(T0 + NS_PER_S)
    timeline.state_at(T0 + NS_PER_S // 2)
    assert timeline.state_at(T0 + NS_PER_S) == first
    assert kernel.work == 1


def test_there_is_no_belief_before_the_earliest_observation():
    timeline = Timeline(Log(), [], SECOND)
    assert timeline.state_at(T0) is None
    timeline.insert(speed(1.0, 0), T0 + NS_PER_S)
    assert timeline.state_at(T0 + NS_PER_S - 1) is None
    assert timeline.state_at(T0 + NS_PER_S) == [20.0]


@pytest.mark.parametrize(
    ("late_s", "now_s", "reason"), [(0.0, 5.0, None), (0.0, 5.1, "too_old"), (0.5, 0.0, None), (0.500001, 0.0, "from_future")]
)
def test_the_horizon_and_the_future_are_refused_at_their_edges(late_s, now_s, reason):
    timeline = Timeline(Log(), [], SECOND)
    assert timeline.insert(speed(late_s, 0), T0 + round(now_s * NS_PER_S)) == reason
    assert timeline.counters.refused == ({reason: 1} if reason else {})
    assert FUTURE_NS == NS_PER_S // 2


def test_the_settled_boundary_stays_when_the_clock_goes_back():
    timeline = Timeline(Log(), [], SECOND)
    timeline.insert(speed(9.0, 0), T0 + 10 * NS_PER_S)
    assert timeline.insert(speed(4.0, 1), T0 + 9 * NS_PER_S) == "too_old"


@pytest.mark.parametrize("change", [{"unit": "v", "order": 1}, {"component": 1}, {"measured_at_ns": T0 + 1}])
def test_another_unit_moment_or_component_is_another_observation(change):
    timeline = Timeline(Log(), [], SECOND)
    assert timeline.insert(speed(0.0, 0), T0) is None
    assert timeline.insert(speed(0.0, 0)._replace(**change), T0) is None


@pytest.mark.parametrize("change", [{"instance": "j"}, {"sequence": 7}, {"value": 21.0}, {"instance": "a", "value": 19.0}])
def test_the_same_moment_of_a_unit_counts_once_whoever_repeats_it(change):
    one = speed(0.0, 0)
    other = one._replace(**change)
    results = []
    for first, second in ((one, other), (other, one)):
        timeline = Timeline(Log(), [], SECOND)
        assert timeline.insert(first, T0) is None
        timeline.state_at(T0)
        assert timeline.insert(second, T0) == "duplicate"
        results.append(timeline.state_at(T0))
    assert results[0] == results[1]
    assert len(results[0]) == 1


def test_the_check_for_untimely_times_changes_nothing():
    timeline = Timeline(Log(), [], SECOND)
    assert timeline.untimely(T0, T0 + 10 * NS_PER_S) == "too_old"
    assert timeline.insert(speed(0.0, 0), T0) is None


def test_folding_settled_observations_changes_no_bit_and_bounds_memory():
    folding, keeping = estimator(), Estimator(Layout(), 1e-3, PRIOR, 10**18)
    rng = np.random.default_rng(0)
    for i in range(20_000):
        t = 0.01 * i
        now = T0 + round(t * NS_PER_S)
        o = speed(t, i, 20.0 + rng.normal())
        folding.insert(o, now)
        keeping.insert(o, now)
        folding.advance_to(now)
    at = T0 + 200 * NS_PER_S
    assert folding.lists_at(at) == keeping.lists_at(at)
    assert len(folding.timeline._chain.knots) < 1000
    assert len(folding.timeline._seen) < 5000


def test_identities_are_forgotten_only_when_age_would_refuse_them_anyway():
    e = estimator()
    for i in range(5000):
        e.insert(speed(0.01 * i, i), T0 + i * NS_PER_S // 100)
        e.advance_to(T0 + i * NS_PER_S // 100)
    now = T0 + 4999 * NS_PER_S // 100
    assert e.insert(speed(0.01 * 4600, 4600), now) == "duplicate"
    assert e.insert(speed(0.01 * 100, 100), now) == "too_old"


def test_feedback_rewinds_to_its_epoch_and_later_observations_are_replayed():
    with_feedback, by_hand = estimator(share=0.5), Estimator(Layout(), 1e-3 / 0.5, PRIOR, SECOND)
    for i in range(20):
        with_feedback.insert(speed(0.1 * i, i), T0 + 2 * NS_PER_S)
    mean, P = np.array([20.0, 21.0, 0.5]), np.diag([0.1, 0.2, 0.3])
    assert with_feedback.accept_feedback(T0 + NS_PER_S, mean, P, 0.5)
    by_hand.start_from(T0 + NS_PER_S, mean, P / 0.5)
    for i in range(11, 20):
        by_hand.insert(speed(0.1 * i, i), T0 + 2 * NS_PER_S)
    assert with_feedback.lists_at(T0 + 2 * NS_PER_S) == by_hand.lists_at(T0 + 2 * NS_PER_S)


def test_superseded_feedback_changes_nothing():
    e = estimator()
    e.insert(speed(0.0, 0), T0)
    assert e.accept_feedback(T0 + NS_PER_S, np.zeros(3), np.eye(3), 1.0)
    before = e.lists_at(T0 + 2 * NS_PER_S)
    assert not e.accept_feedback(T0 + NS_PER_S, np.ones(3), np.eye(3), 1.0)
    assert not e.accept_feedback(T0 + NS_PER_S // 2, np.ones(3), np.eye(3), 1.0)
    assert e.lists_at(T0 + 2 * NS_PER_S) == before


def test_an_observation_older_than_the_feedback_is_absorbed_once():
    e = estimator()
    e.accept_feedback(T0 + NS_PER_S, np.zeros(3), np.eye(3), 1.0)
    before = e.lists_at(T0 + 2 * NS_PER_S)
    assert e.insert(speed(0.9, 0), T0 + NS_PER_S) == "absorbed"
    assert e.insert(speed(0.9, 0), T0 + NS_PER_S) == "duplicate"
    assert e.lists_at(T0 + 2 * NS_PER_S) == before


def test_feedback_on_common_states_alone_conditions_the_private_ones():
    layout = Layout((("u", (PrivateState("bias", 0.0, 0.3),)),))
    e = Estimator(layout, 1e-3, PRIOR, SECOND)
    e.insert(speed(0.0, 0, 20.5)._replace(row=(0.0, 1.0, 0.0, 1.0)), T0)
    assert e.accept_feedback(T0, np.array([0.0, 20.0, 0.0]), np.diag([0.01, 1e-4, 1e-4]), 1.0)
    mean, P = e.state_at(T0)
    # with the speed known to be 20, the reading of 20.5 was bias: shrunk from 0.5 by the prior's and the reading's variance
    assert mean[3] == pytest.approx(0.5 * 0.09 / (0.09 + 0.04), rel=0.01)
    assert P[3, 3] < 0.09


def test_a_row_of_the_wrong_size_is_an_error():
    with pytest.raises(ValueError, match="u: a row has 3 entries"):
        estimator().insert(speed(0.0, 0)._replace(row=(1.0, 0.0)), T0)


def test_rows_are_lifted_to_their_own_block():
    layout = Layout((("a", (PrivateState("x", 0.0, 1.0),)), ("b", (PrivateState("y", 0.0, 1.0), PrivateState("z", 0.0, 1.0)))))
    assert layout.lift("b", (0.0, 1.0, 0.0, 5.0, 6.0)) == (0.0, 1.0, 0.0, 0.0, 5.0, 6.0)
    assert layout.lift("c", (1.0, 0.0, 0.0)) == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert layout.names[3:] == ["a.x", "b.y", "b.z"]


def test_the_interval_is_k_sigmas_and_the_accuracy_on_either_side():
    assert interval(100.0, 0.04, 5.0, 0.5) == pytest.approx((98.5, 101.5))
