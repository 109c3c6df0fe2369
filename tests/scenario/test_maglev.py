"""The simulated train, GIVEN a fault, WHEN it strikes, THEN the state says so, and the truth stays inside the interval."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from harness import PERIOD_NS, ROOT, Journey, at, scenario_s, travel, widths

from milepost.evaluation.plan import make_plan
from milepost.evaluation.run_log import RunLog
from milepost.evaluation.scenario_run import run_plan
from milepost.nodes.base import Output
from milepost.simulation.faults import delayed, silent
from milepost_schemas import BaliseTelegram, Estimate, Gaussian, LinearObservation

SOURCE_A = ROOT / "deploy/scenarios/loop-radar-balise.yaml"
COMMON = ["position_m", "speed_mps", "acceleration_mps2"]


@pytest.fixture(scope="module")
def source_a() -> tuple[dict[str, Any], RunLog]:
    """Source A's two kilometres with the scenario's own seed, no device wrong."""
    plan = make_plan(SOURCE_A)
    run = run_plan(replace(plan, cases=plan.cases[:1]), None, lambda done_s: None)
    return run.result, run.log


@pytest.fixture(scope="module")
def undisturbed() -> Journey:
    """The default train, nothing going wrong."""
    return travel(24.0)


class TestSourceA:
    def test_the_loop_alone_drifts_to_several_tenths_of_a_metre(self, source_a):
        loop = source_a[0]["estimators"]["loop_only"]
        assert 0.2 < loop["position_final_m"] < 1.0
        assert 0.2 < loop["position_rms_m"] < 1.0

    def test_the_fused_position_stays_near_three_centimetres(self, source_a):
        fused = source_a[0]["estimators"]["fused"]
        assert 0.02 < fused["position_rms_m"] < 0.04
        assert fused["position_max_m"] < 0.15
        assert fused["speed_rms_mps"] < 0.012
        assert fused["position_rms_m"] < 0.2 * source_a[0]["estimators"]["loop_only"]["position_rms_m"]

    def test_the_fused_state_is_as_good_as_the_centralised_one(self, source_a):
        fused, best = source_a[0]["estimators"]["fused"], source_a[0]["estimators"]["centralised"]
        assert fused["position_rms_m"] / best["position_rms_m"] == pytest.approx(1.0, abs=1e-6)
        assert fused["speed_rms_mps"] / best["speed_rms_mps"] == pytest.approx(1.0, abs=1e-6)
        assert source_a[0]["fused_minus_centralised_max_sigma"] < 1e-6

    def test_the_sources_rule_stands_beside_within_a_third_of_the_optimum(self, source_a):
        federated, best = source_a[0]["estimators"]["federated"], source_a[0]["estimators"]["centralised"]
        assert 1.0 < federated["position_rms_m"] / best["position_rms_m"] < 1.3
        assert 1.0 < federated["speed_rms_mps"] / best["speed_rms_mps"] < 1.3

    def test_the_errors_are_as_large_as_the_covariance_says(self, source_a):
        assert 2.0 < source_a[0]["estimators"]["fused"]["nees_mean"] < 4.0

    @pytest.mark.parametrize("which", ["live", "settled"])
    def test_states_at_fifty_hertz_without_gaps_contain_the_truth(self, source_a, which):
        log = source_a[1]
        states = list(getattr(log, which).values())
        assert len(states) >= 100.0 * 50 - 2
        assert {b.measured_at_ns - a.measured_at_ns for a, b in pairwise(states)} == {PERIOD_NS}
        assert {b.epoch - a.epoch for a, b in pairwise(states)} == {1}
        assert all(state.epoch * PERIOD_NS == state.measured_at_ns for state in states)
        # the truth of the very last epoch is told after the end
        for state in states[:-1]:
            position, speed, _ = log.truth[state.measured_at_ns]
            assert state.position_min_m <= position <= state.position_max_m
            assert state.speed_min_mps <= speed <= state.speed_max_mps


def test_the_first_second_is_initialising_and_then_normal(undisturbed):
    first = min(undisturbed.settled)
    for states in (undisturbed.live, undisturbed.settled):
        early = {s.status for ns, s in states.items() if ns - first < 990_000_000}
        late = {s.status for ns, s in states.items() if ns - first > 1_010_000_000}
        assert (early, late) == ({"initialising"}, {"normal"})
    assert undisturbed.outside() == []


def test_live_states_wait_for_nobody_when_all_are_punctual(undisturbed):
    states = undisturbed.between(0.04, 25.0)
    assert {s.published_at_ns - s.measured_at_ns for s in states} == {0}
    assert not any(s.awaiting for s in states)


class TestRadarSilentForTenSeconds:
    @pytest.fixture(scope="class")
    @classmethod
    def journey(cls) -> Journey:
        """From 6 s to 16 s the radar says nothing."""
        return travel(24.0, {"sensor-radar": silent(6.0, 16.0)})

    def test_the_silent_radar_is_excluded_until_it_is_back(self, journey):
        for states in (journey.live, journey.settled):
            during = [s for ns, s in states.items() if at(7.02) <= ns < at(15.98)]
            assert {s.status for s in during} == {"degraded"}
            assert {(e.unit, e.reason) for s in during for e in s.excluded} == {("radar", "silent")}
            assert all([u.unit for u in s.sensors] == ["loop"] and s.sensors[0].share == 1.0 for s in during)
            otherwise = [s for ns, s in states.items() if at(1.1) <= ns < at(6.9) or ns >= at(16.02)]
            assert {s.status for s in otherwise} == {"normal"}
            assert not any(s.excluded for s in otherwise)

    def test_the_interval_is_wider_without_it_and_as_narrow_as_ever_afterwards(self, journey, undisturbed):
        for t in (9.9, 14.9):
            with_it, without = undisturbed.live[at(t)], journey.live[at(t)]
            assert widths([without])[0] > widths([with_it])[0]
            assert without.speed_max_mps - without.speed_min_mps > 1.3 * (with_it.speed_max_mps - with_it.speed_min_mps)
        late = at(23.9)
        assert widths([journey.live[late]])[0] == pytest.approx(widths([undisturbed.live[late]])[0], rel=0.05)

    def test_the_interval_grows_from_fix_to_fix(self, journey):
        between = widths(journey.between(10.2, 14.9))
        assert all(b > a for a, b in pairwise(between))

    def test_the_truth_stays_inside(self, journey):
        assert journey.outside() == []

    def test_it_is_awaited_once_and_then_not_waited_for(self, journey):
        late = [s for s in journey.between(0.04, 25.0) if s.published_at_ns > s.measured_at_ns]
        assert [scenario_s(s) for s in late] == [pytest.approx(6.0, abs=0.021)]
        assert late[0].published_at_ns - late[0].measured_at_ns == 15_000_000
        assert late[0].awaiting == ["radar"]


class TestRadarAndLoopSilent:
    @pytest.fixture(scope="class")
    @classmethod
    def journey(cls) -> Journey:
        """From 5.5 s to 13.5 s nothing measures speed, and the balise at 10 s is missed too."""
        gone = silent(5.5, 13.5)
        return travel(18.0, {"sensor-radar": gone, "sensor-loop": gone, "sensor-balise-reader": gone})

    def test_it_coasts_and_comes_back(self, journey):
        """It is lost once it might have braked by more than `lost_above_m`, and knows its place again with the next balise."""
        during = journey.between(6.52, 13.48)
        assert {s.status for s in during if scenario_s(s) < 9.3} == {"coasting"}
        limit_m = journey.train.file.fusion.lost_above_m
        assert {(s.status == "lost") == (s.position_max_m - s.position_min_m > 2.0 * limit_m) for s in during} == {True}
        assert {s.status for s in during} == {"coasting", "lost"}
        assert {e.unit for e in during[0].excluded} == {"radar", "loop"}
        assert not any(s.sensors for s in during)
        assert {s.status for s in journey.between(14.0, 18.0)} == {"normal"}

    def test_states_go_on_without_a_hole(self, journey):
        assert {b.epoch - a.epoch for a, b in pairwise(journey.live.values())} == {1}

    def test_the_interval_keeps_growing_and_holds_the_truth(self, journey):
        during = journey.between(5.54, 13.48)
        assert all(b > a for a, b in pairwise(widths(during)))
        assert all(b > a for a, b in pairwise([s.speed_max_mps - s.speed_min_mps for s in during]))
        assert widths(during)[-1] > 1.3 * widths(during)[0]
        assert journey.outside() == []


class TestBaliseReaderSilent:
    @pytest.fixture(scope="class")
    @classmethod
    def journey(cls) -> Journey:
        """The balises at 10 s, 15 s and 20 s are missed; the one at 25 s is read."""
        return travel(27.0, {"sensor-balise-reader": silent(7.0, 22.0)})

    def test_the_interval_grows_up_to_the_next_fix_and_shrinks_there(self, journey):
        fixed = [ns for ns, s in journey.live.items() if s.last_balise and s.last_balise.position_m == 500.0]
        before = widths(journey.between(5.2, (min(fixed) - at(0.0)) / 1e9))
        assert len(before) > 900
        assert all(b >= a for a, b in pairwise(before))
        assert widths([journey.live[min(fixed)]])[0] < 0.9 * before[-1]

    def test_it_says_how_far_the_last_balise_is_behind(self, journey):
        last = journey.live[at(24.0)].last_balise
        assert last is not None
        assert last.position_m == 100.0
        assert last.distance_since_m == pytest.approx(journey.truth[at(24.0)].position_m - 100.0, abs=0.5)

    def test_the_interval_never_holds_less_than_the_truth(self, journey):
        assert journey.outside() == []


class TestLateBaliseTelegram:
    @pytest.fixture(scope="class")
    @classmethod
    def journey(cls) -> Journey:
        """The telegram of the balise at about 10 s takes a second and a half."""
        return travel(24.0, {"sensor-balise-reader": delayed(1.5, 7.0, 12.0)})

    def test_it_rewinds_and_settles_to_the_same_bits_as_a_punctual_one(self, journey, undisturbed):
        assert journey.settled_bytes() == undisturbed.settled_bytes()

    def test_until_it_comes_the_state_goes_on_without_it_and_then_with_it(self, journey, undisturbed):
        before, after = journey.live[at(11.2)], journey.live[at(11.8)]
        assert before.last_balise is not None
        assert before.last_balise.position_m == 100.0
        assert after.last_balise is not None
        assert after.last_balise.position_m == 200.0
        assert widths([before])[0] > widths([undisturbed.live[at(11.2)]])[0]
        assert after.position_m == pytest.approx(undisturbed.live[at(11.8)].position_m, abs=1e-9)

    def test_a_telegram_later_than_the_horizon_is_refused_and_changes_nothing(self):
        late = travel(18.0, {"sensor-balise-reader": delayed(5.5, 7.0, 12.0)})
        never = travel(18.0, {"sensor-balise-reader": silent(7.0, 12.0)})
        assert late.fuser.refusals.counts == {"too_old": 1}
        assert [e.code for e in late.events] == ["balise_missed", "refused_too_old"]
        assert late.settled_bytes() == never.settled_bytes()


def test_an_unknown_balise_id_is_an_event_and_changes_nothing(undisturbed):
    head = {"train": "maglev-1", "unit": "balise-reader", "instance": "another", "sequence": 0}
    stamps = {"measured_at_ns": at(7.003), "published_at_ns": at(7.013)}
    telegram = BaliseTelegram(**head, **stamps, balise_id="nobody-knows", reader_variance_m2=0.0004)
    journey = travel(24.0, happening=[(7.013, Output("balise_telegram", "balise-reader", telegram))])
    assert [(e.unit, e.code, e.severity) for e in journey.events] == [("balise", "unknown_balise", "warning")]
    assert "nobody-knows" in journey.events[0].text
    assert journey.live == undisturbed.live
    assert journey.settled == undisturbed.settled


class TestDueReadings:
    @pytest.fixture(scope="class")
    @classmethod
    def journey(cls) -> Journey:
        """The radar's estimates take 12 ms, between 3 s and 5 s they take 40 ms."""
        return travel(8.0, {"filter-radar": lambda t_s, message: 0.040 if 3.0 <= t_s < 5.0 else 0.012})

    def waits_ms(self, states: list[Any]) -> set[float]:
        return {(s.published_at_ns - s.measured_at_ns) / 1e6 for s in states}

    def test_an_epoch_waits_for_a_due_reading_up_to_the_deadline(self, journey):
        punctual = journey.between(1.0, 2.98)
        assert self.waits_ms(punctual) == {12.0}
        assert not any(s.awaiting for s in punctual)
        assert all(next(u.age_s for u in s.sensors if u.unit == "radar") == 0.0 for s in punctual)

    def test_past_the_deadline_it_goes_without_and_says_who_was_awaited(self, journey):
        first = next(s for s in journey.between(2.98, 5.0) if s.awaiting)
        assert self.waits_ms([first]) == {15.0}
        assert first.awaiting == ["radar"]

    def test_an_unpunctual_unit_is_not_waited_for_until_it_is_punctual_again(self, journey):
        late = journey.between(3.04, 5.0)
        assert self.waits_ms(late) == {0.0}
        assert {tuple(s.awaiting) for s in late} == {("radar",)}
        again = journey.between(5.06, 8.0)
        assert self.waits_ms(again[:-1]) == {12.0}
        assert not any(s.awaiting for s in again[:-1])

    def test_what_came_late_is_in_the_settled_states_all_the_same(self, journey):
        assert len(journey.settled) > 390
        assert journey.settled_bytes() == travel(8.0).settled_bytes()[: len(journey.settled)]

    def test_a_unit_whose_token_is_gone_is_not_waited_for(self):
        """The radar stops at 3 s and its token goes with it: no epoch waits for a deadline."""
        gone = (2.995, lambda journey: journey.fuser.unit_alive("sensor-radar", False))
        journey = travel(5.0, {"sensor-radar": silent(2.995, 5.0)}, happening=[gone])
        after = journey.between(3.0, 5.0)
        assert self.waits_ms(after) == {0.0}
        assert {(e.unit, e.reason) for s in after for e in s.excluded} == {("radar", "process gone")}
        assert {s.status for s in after} == {"degraded"}


def test_without_feedback_the_states_settle_to_the_same_bits(undisturbed):
    journey = travel(24.0, change={"fusion": {"feedback": False}})
    assert journey.feedbacks == 0 < undisturbed.feedbacks
    assert journey.settled_bytes() == undisturbed.settled_bytes()


def standing_train(faults: dict[str, Any] | None = None) -> Journey:
    """2 m/s, braking to a stand at 10 s, with nothing but the loop and balises."""
    change = {
        "motion_model": {"jerk_psd_m2ps5": 0.01},
        "prior": {"speed_mps": 2.0, "acceleration_mps2": -0.2, "acceleration_std_mps2": 0.1},
        "fusion": {"shares": {"radar": 0.0, "loop": 1.0}},
        "world": {
            "motion": {
                "profile": [[0.0, 2.0], [10.0, 0.0]],
                "jerk_psd_m2ps5": 0.0,
                "driver_time_s": None,
                "start_std": [0.0, 0.0, 0.0],
            }
        },
    }
    return travel(16.0, {"sensor-radar": silent(0.0, 99.0), **(faults or {})}, change)


def told_apart(message: Any) -> bool:
    return getattr(message, "speed_max_mps", None) is not None


class TestStandingStill:
    @pytest.fixture(scope="class")
    @classmethod
    def journey(cls) -> Journey:
        return standing_train()

    def test_silence_of_the_loop_bounds_the_speed(self, journey):
        """Beside a loop that says nothing when it has no pulse, the bound is seen to be what keeps the interval narrow."""
        mute = standing_train({"sensor-loop": lambda t_s, message: None if told_apart(message) else 0.0})
        t = at(13.0)
        assert mute.truth[t].speed_mps == pytest.approx(0.0, abs=1e-9)
        with_it, without = journey.live[t], mute.live[t]
        assert with_it.speed_accuracy_mps < 0.5 * without.speed_accuracy_mps

    def test_the_intervals_hold_the_truth_at_two_metres_a_second_and_standing(self, journey):
        assert journey.truth[at(1.0)].speed_mps == pytest.approx(1.8)
        assert journey.outside() == []

    def test_silence_is_never_taken_for_zero(self, journey):
        """After five seconds without a pulse the speed interval still has room for a creeping train."""
        last = journey.live[at(15.0)]
        assert last.speed_min_mps < -0.005 < 0.005 < last.speed_max_mps


def test_an_accelerating_and_braking_train_stays_inside_its_intervals():
    change = {
        "motion_model": {"jerk_psd_m2ps5": 0.1},
        "prior": {"speed_mps": 5.0, "speed_std_mps": 0.5, "acceleration_std_mps2": 1.0},
        "world": {"motion": {"profile": [[0.0, 5.0], [12.0, 17.0], [18.0, 17.0], [26.0, 5.0]], "driver_time_s": 30.0}},
    }
    journey = travel(30.0, change=change)
    speeds = [truth.speed_mps for truth in journey.truth.values()]
    assert max(speeds) - min(speeds) > 10.0
    assert {s.status for s in journey.between(1.1, 30.0)} == {"normal"}
    errors = [s.position_m - journey.truth[ns].position_m for ns, s in journey.settled.items() if at(13.0) < ns < at(30.0)]
    assert max(map(abs, errors)) < 0.3
    assert journey.outside() == []


@pytest.mark.parametrize(("rule", "status"), [("information", "degraded"), ("federated", "lost")])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_impossible_estimate_excludes_its_unit_or_is_lost(rule, status, sign):
    """A filter gone mad says a thousand million metres, very sure of it, and goes on saying so."""
    covariance = [[1e-9, 0.0, 0.0], [0.0, 1e-9, 0.0], [0.0, 0.0, 1e-9]]

    def mad(number: int, t_s: float) -> Output:
        row, value = ([1.0, 0.0, 0.0], 1e9) if number % 2 else ([0.0, 1.0, 0.0], 1e6)
        seen = LinearObservation(
            sensor_instance="mad",
            reading_sequence=number,
            measured_at_ns=at(t_s),
            row=row,
            value=sign * value,
            variance=1e-9,
        )
        head = {"train": "maglev-1", "unit": "radar", "instance": "mad", "sequence": number}
        stamps = {"measured_at_ns": at(t_s), "published_at_ns": at(t_s)}
        belief = Gaussian(states=COMMON, mean=[sign * 1e9, sign * 1e6, 0.0], covariance=covariance)
        told = Estimate(**head, **stamps, belief=belief, observations=[seen], feedback_epoch_ns=at(t_s))
        return Output("estimate", "radar", told)

    times = [3.0 + 0.01 * n + 0.001 for n in range(50)]
    journey = travel(
        5.0,
        {"filter-radar": silent(3.0, 5.0)},
        {"fusion": {"rule": rule}},
        happening=[(t, mad(n, t)) for n, t in enumerate(times)],
    )
    assert {s.status for s in journey.between(1.1, 3.0)} == {"normal"}
    assert status in {s.status for s in journey.between(3.02, 3.5)}
    assert {b.epoch - a.epoch for a, b in pairwise(journey.live.values())} == {1}
    assert max(journey.live) == at(5.0)
