"""The checks of a published interval, on epochs made by hand."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from milepost.checks.figures import check_all, figures
from milepost.checks.monotonic import steps_beyond_travelled_m
from milepost.checks.requirements import CHECKS, speed_law_mps
from milepost.checks.table import check_lines
from milepost.evaluation.scores import SCORES
from milepost.evaluation.summary import summary
from milepost.evaluation.trace import Trace, trace_of_states

KMH = 1.0 / 3.6
NOBODY: Any = SimpleNamespace(sensors={})


def epochs(*rows: dict[str, Any], **fields: Any) -> Trace:
    """An epoch for each row, a second apart. Where a row is silent: estimate and truth at 0 m and 10 m/s, ±1 around them."""
    full = [{"s": 0.0, "v": 10.0, "error": (0.0, 0.0), "reach": (1.0, 1.0), "accuracy": (0.5, 0.5), **row} for row in rows]
    states = np.array([(row["s"], row["v"], 0.0) for row in full])
    truth = states - [(*row["error"], 0.0) for row in full]
    (s, v, _), (a, b) = states.T, np.array([row["reach"] for row in full]).T
    return Trace(
        np.arange(len(full), dtype=float),
        states,
        np.tile(np.eye(3), (len(full), 1, 1)),
        truth,
        bounds=np.column_stack([s - a, s + a, v - b, v + b]),
        accuracy=np.array([row["accuracy"] for row in full]),
        since_balise_m=np.array([row.get("since", np.nan) for row in full]),
        location_accuracy_m=np.array([row.get("location", 0.0) for row in full]),
        lost=np.array([row.get("lost", False) for row in full]),
        **fields,
    )


def of(name: str, trace: Trace) -> dict[str, float]:
    found = figures(name, trace)
    assert found is not None
    return found


def test_a_truth_outside_is_counted_for_position_and_speed_apart() -> None:
    given = epochs({"error": (3.0, 0.0)}, {"error": (-1.5, 0.0)}, {"error": (1.0, 4.0)}, {})
    assert of("position_interval", given) == {
        "epochs": 4, "violations": 2, "violations_share": 0.5, "worst_m": 2.0,
        "width_median_m": 2.0, "width_p95_m": 2.0, "width_max_m": 2.0,
    }  # fmt: skip
    speed = of("speed_interval", given)
    assert (speed["violations"], speed["violations_share"], speed["worst_mps"]) == (1, 0.25, 3.0)


def test_no_violation_has_no_worst_case() -> None:
    assert of("position_interval", epochs({"error": (1.0, 0.0)}))["worst_m"] == 0.0


def test_widths_are_median_95th_percentile_and_largest() -> None:
    given = of("position_interval", epochs(*({"reach": (k / 2.0, 1.0)} for k in range(21))))
    assert (given["width_median_m"], given["width_p95_m"], given["width_max_m"]) == (10.0, 19.0, 20.0)


class TestSubset041:
    def test_the_permitted_distance_error_grows_with_the_distance(self) -> None:
        # 5 m + 5 %: 5, 10 and 10 m
        given = epochs(
            {"since": 0.0, "error": (5.5, 0.0), "reach": (5.0, 1.0)},
            {"since": 100.0, "error": (9.0, 0.0), "reach": (10.0, 1.0)},
            {"since": 100.0, "error": (-12.0, 0.0), "reach": (10.5, 1.0)},
        )
        found = of("subset_041_position", given)
        assert (found["epochs"], found["violations"], found["worst_m"]) == (3, 2, 2.0)
        assert found["availability"] == pytest.approx(2 / 3)
        assert found["width_max_m"] == 10.5

    def test_the_location_accuracy_of_the_balise_comes_on_top(self) -> None:
        given = epochs({"since": 0.0, "location": 12.0, "error": (17.0, 0.0), "reach": (17.0, 1.0)})
        found = of("subset_041_position", given)
        assert (found["violations"], found["availability"]) == (0, 1.0)

    def test_the_wider_side_of_an_asymmetric_interval_counts(self) -> None:
        given = epochs({"since": 0.0})
        given.bounds[0, :2] = -1.0, 6.0  # type: ignore[index]
        assert of("subset_041_position", given)["availability"] == 0.0
        assert of("subset_041_position", given)["width_max_m"] == 6.0

    def test_a_distance_run_backwards_counts_by_its_size(self) -> None:
        given = epochs({"since": -100.0, "v": -10.0, "error": (9.0, 0.0), "reach": (9.0, 1.0)})
        found = of("subset_041_position", given)
        assert (found["violations"], found["availability"]) == (0, 1.0)

    def test_epochs_before_the_first_balise_do_not_count(self) -> None:
        assert of("subset_041_position", epochs({"reach": (99.0, 1.0)}, {"since": 0.0}))["epochs"] == 1
        assert figures("subset_041_position", epochs({}, {})) is None

    @pytest.mark.parametrize(
        ("speed_kmh", "permitted_kmh"), [(0.0, 2.0), (30.0, 2.0), (265.0, 7.0), (500.0, 12.0), (-265.0, 7.0), (600.0, 12.0)]
    )
    def test_the_speed_law(self, speed_kmh: float, permitted_kmh: float) -> None:
        assert speed_law_mps(np.array([speed_kmh * KMH])) == pytest.approx(permitted_kmh * KMH)

    def test_errors_are_held_against_true_speeds_widths_against_estimates(self) -> None:
        # estimate 265 km/h (7 km/h permitted), truth 275 km/h: 2 + 245·10/470 = 7.213 km/h
        given = epochs({"v": 265.0 * KMH, "error": (0.0, -10.0 * KMH), "reach": (1.0, 7.1 * KMH)})
        found = of("subset_041_speed", given)
        assert found["worst_mps"] == pytest.approx((10.0 - 2.0 - 2450.0 / 470.0) * KMH)
        assert (found["violations"], found["availability"]) == (1, 0.0)

    def test_a_train_that_stands_may_err_by_two_kilometres_an_hour(self) -> None:
        given = epochs({"v": 0.0, "error": (0.0, 1.9 * KMH), "reach": (1.0, 2.0 * KMH)}, {"v": 0.0, "error": (0.0, 2.1 * KMH)})
        found = of("subset_041_speed", given)
        assert (found["violations"], found["availability"]) == (1, 0.5)


class TestLocOb:
    def test_the_position_errs_by_at_most_five_metres(self) -> None:
        # stated with 95 %: 4.9 and 5.0 m; with 95.4 %: 5.0 and 5.1 m
        given = epochs({"error": (5.1, 0.0), "accuracy": (4.8999, 0.5)}, {"error": (-4.9, 0.0), "accuracy": (5.0, 0.5)})
        found = of("loc_ob_position", given)
        assert (found["violations"], found["availability"]) == (1, 0.5)
        assert found["worst_m"] == pytest.approx(0.1)
        assert found["width_max_m"] == pytest.approx(5.0 * 2.0 / 1.959964)

    def test_the_speed_errs_by_one_kilometre_an_hour_or_a_percent(self) -> None:
        given = epochs(
            {"v": 50.0 * KMH, "error": (0.0, 1.1 * KMH), "accuracy": (0.5, 0.9 * KMH)},
            {"v": 200.0 * KMH, "error": (0.0, 1.9 * KMH), "accuracy": (0.5, 1.9 * KMH)},
            {"v": 0.0, "error": (0.0, 0.9 * KMH), "accuracy": (0.5, 1.1 * KMH)},
        )
        found = of("loc_ob_speed", given)
        assert (found["violations"], found["availability"]) == (1, pytest.approx(2 / 3))

    def test_the_safe_interval_is_thirty_metres_or_a_second(self) -> None:
        given = epochs({"v": 0.0, "reach": (15.0, 1.0)}, {"v": 0.0, "reach": (15.5, 1.0)}, {"v": -40.0, "reach": (20.0, 1.0)})
        found = of("loc_ob_safe_interval", given)
        assert found["availability"] == pytest.approx(2 / 3)
        # a truth outside it is counted by `position_interval` alone
        assert "violations" not in found

    def test_nodes_ask_for_more_and_only_on_request(self) -> None:
        given = epochs({"error": (1.5, 0.0), "reach": (5.5, 1.0)})
        assert of("loc_ob_node_position", given)["violations"] == 1
        assert of("loc_ob_node_safe_interval", given)["availability"] == 0.0
        assert not {name for name in check_all(given) if "node" in name}


def test_a_coasting_state_counts_like_any_other_a_lost_one_is_unavailable() -> None:
    # 10 km after the last balise 505 m are permitted
    far = {"since": 10_000.0, "reach": (400.0, 1.0), "error": (401.0, 0.0)}
    found = of("subset_041_position", epochs(far, {**far, "lost": True}))
    assert (found["violations"], found["availability"]) == (0, 0.5)
    assert of("position_interval", epochs(far, {**far, "lost": True}))["violations"] == 2


def test_the_accuracy_without_faults_holds_the_truth_as_often_as_stated() -> None:
    given = epochs({"error": (0.6, 0.4)}, *({"error": (0.1, -0.7)} for _ in range(3)))
    assert of("position_accuracy", given)["violations_share"] == 0.25
    assert of("speed_accuracy", given)["violations_share"] == 0.75
    assert of("speed_accuracy", given)["worst_mps"] == pytest.approx(0.2)


class TestMonotonic:
    """OC-7244: neither end of the train advances by more than the train travelled."""

    @staticmethod
    def steps(
        s: list[float], reach: list[float], v: list[float], heading: list[float], reset: list[bool] | None = None
    ) -> list[list[float]]:
        places, reaches = np.array(s), np.array(reach)
        bounds = np.column_stack([places - reaches, places + reaches])
        t = np.arange(len(s), dtype=float)
        flags = np.array([False] * len(s) if reset is None else reset)
        return steps_beyond_travelled_m(t, np.array(v), np.array(heading), bounds, flags).tolist()

    def test_an_interval_that_travels_along_advances_by_nothing(self) -> None:
        assert self.steps([0.0, 10.0, 25.0], [2.0] * 3, [10.0, 10.0, 20.0], [1.0] * 3)[1:] == [[0.0, 0.0], [0.0, 0.0]]

    def test_the_first_epoch_has_no_step(self) -> None:
        assert np.isnan(self.steps([0.0, 10.0], [2.0] * 2, [10.0] * 2, [1.0] * 2)[0]).all()

    def test_a_shrinking_interval_lets_the_rear_advance(self) -> None:
        assert self.steps([0.0, 10.0], [2.0, 0.5], [10.0] * 2, [1.0] * 2)[1] == [1.5, -1.5]

    def test_a_growing_interval_lets_the_front_advance(self) -> None:
        assert self.steps([0.0, 10.0], [2.0, 2.5], [10.0] * 2, [1.0] * 2)[1] == [-0.5, 0.5]

    def test_backwards_the_rear_is_the_upper_bound(self) -> None:
        assert self.steps([0.0, -10.0], [2.0, 0.5], [-10.0] * 2, [-1.0] * 2)[1] == [1.5, -1.5]

    def test_a_train_that_stands_keeps_its_direction_and_travels_nothing(self) -> None:
        assert self.steps([0.0, 0.0, 0.0], [2.0, 2.0, 1.0], [0.0] * 3, [-1.0, 0.0, 0.0])[1:] == [[0.0, 0.0], [1.0, -1.0]]

    def test_without_any_direction_yet_nothing_is_rear_or_front(self) -> None:
        assert np.isnan(self.steps([0.0, 0.0], [2.0, 1.0], [0.0] * 2, [0.0] * 2)).all()

    def test_rolling_back_is_no_travel_forward(self) -> None:
        assert self.steps([0.0, -1.0], [2.0, 2.0], [-1.0, -1.0], [1.0, 1.0])[1] == [-1.0, -1.0]

    def test_a_reversal_is_measured_in_the_direction_before_it(self) -> None:
        # 1 m/s forward, then 1 m/s backward: nothing travelled; the interval shrinks by 1 m on either side
        assert self.steps([0.0, 0.0], [2.0, 1.0], [1.0, -1.0], [1.0, -1.0])[1] == [1.0, -1.0]

    def test_an_announced_reset_is_excepted(self) -> None:
        assert np.isnan(self.steps([0.0, 50.0], [2.0, 2.0], [10.0] * 2, [1.0] * 2, [False, True])[1]).all()

    def test_the_check_counts_steps_and_leaves_out_epochs_without(self) -> None:
        given = epochs({}, {}, {}, {}, steps_m=np.array([[np.nan, np.nan], [1.5, -1.5], [1e-9, 0.2], [-1.0, 0.3]]))
        rear, front = of("oc_7244_rear", given), of("oc_7244_front", given)
        assert (rear["epochs"], rear["violations"], rear["worst_m"]) == (3, 1, 1.5)
        assert (front["violations"], front["worst_m"], front["step_median_m"]) == (2, 0.3, 0.2)

    def test_a_stamp_that_goes_back_is_counted(self) -> None:
        found = of("position_stamp", epochs({}, stamps_s=np.array([0.0, 0.02, 0.06, 0.04, 0.08])))
        assert found == {"epochs": 4, "violations": 1, "violations_share": 0.25, "worst_s": pytest.approx(0.02)}


def test_without_a_truth_or_an_interval_there_is_nothing_to_check() -> None:
    nothing = Trace(np.zeros(1), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)))
    assert check_all(nothing) == {}
    without_truth = Trace(np.zeros(1), np.zeros((1, 3)), np.eye(3)[None], None, np.zeros((1, 4)))
    assert check_all(without_truth) == {}


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_a_scenario_can_request_every_check(name: str) -> None:
    given = epochs({"since": 1.0}, {"since": 1.0}, steps_m=np.zeros((2, 2)), stamps_s=np.arange(2.0))
    row = SCORES[name]
    figure = row.compute(given, NOBODY, row.options())
    assert isinstance(figure, dict)
    assert figure == figures(name, given)
    assert figure["epochs"] > 0


def state(at: int, **fields: Any) -> Any:
    told = {
        "position_m": 10.0 * at, "speed_mps": 10.0, "acceleration_mps2": 0.0, "covariance": np.diag([4.0, 1.0, 1.0]),
        "position_min_m": 10.0 * at - 2.0, "position_max_m": 10.0 * at + 2.0, "speed_min_mps": 9.0, "speed_max_mps": 11.0,
        "direction": "forward", "status": "normal", "last_balise": None, "sensors": [],
        "measured_at_ns": at * 10**9, "published_at_ns": at * 10**9,
    }  # fmt: skip
    return SimpleNamespace(**{**told, **fields})


def trace_of(*states: Any, truth_at: tuple[int, ...] | None = None) -> Trace:
    by_time = {each.measured_at_ns: each for each in states}
    truth = {at: [0.0, 0.0, 0.0] for at in (by_time if truth_at is None else truth_at)}
    return trace_of_states(by_time, truth, 0, by_time, {}, ["position_m", "speed_mps", "acceleration_mps2"], {"b": 0.3})


def test_a_trace_takes_what_the_checks_need_from_states() -> None:
    passed = SimpleNamespace(balise_id="b", distance_since_m=7.0)
    given = trace_of(
        state(0), state(1, last_balise=passed, status="lost"), state(2, position_min_m=19.0, direction="standstill")
    )
    assert given.accuracy is not None
    assert given.accuracy[0] == pytest.approx([2.0 * 1.959964, 1.959964])
    assert np.array_equal(given.since_balise_m, [np.nan, 7.0, np.nan], equal_nan=True)
    assert given.location_accuracy_m.tolist() == [0.0, 0.3, 0.0]
    assert given.lost.tolist() == [False, True, False]
    assert given.steps_m[1:].tolist() == [[0.0, 0.0], [1.0, 0.0]]
    assert given.stamps_s.tolist() == [0.0, 1.0, 2.0]


def test_epochs_without_a_truth_do_not_count() -> None:
    given = trace_of(state(0), state(1), state(2), truth_at=(0, 2 * 10**9))
    assert of("position_interval", given)["epochs"] == 2
    # over the gap the train travelled 20 m
    assert given.steps_m is not None
    assert given.steps_m[1].tolist() == [0.0, 0.0]


def test_a_state_that_states_its_accuracy_and_resets_is_taken_at_its_word() -> None:
    given = trace_of(state(0), state(1, position_accuracy_m=0.7, speed_accuracy_mps=0.2, reset={"size_m": 3.0}))
    assert given.accuracy[1].tolist() == [0.7, 0.2]
    assert np.isnan(given.steps_m[1]).all()


def test_many_seeds_become_medians_and_the_worst_of_each_figure() -> None:
    def seed(violations: float, availability: float) -> dict[str, Any]:
        checked = {"x": {"epochs": 9, "violations": violations, "availability": availability}}
        return {"scenario": "s", "seed": 0, "duration_s": 1.0, "estimators": {}, "checks": {"fused": checked}}

    out = summary([seed(1.0, 0.9), seed(5.0, 0.7), seed(2.0, 1.0)])["checks"]["fused"]["x"]
    assert out == {"epochs": 9, "violations": 2, "availability": 0.9,
                   "worst": {"epochs": 9, "violations": 5, "availability": 0.7}}  # fmt: skip


def test_a_check_that_only_some_seeds_have_is_of_those_seeds() -> None:
    seeds = [
        {"scenario": "s", "seed": 0, "duration_s": 1.0, "estimators": {}, "checks": {"fused": checked}}
        for checked in ({}, {"x": {"violations": 3.0}})
    ]
    assert summary(seeds)["checks"]["fused"]["x"]["violations"] == 3.0


def test_the_printed_table_fits_a_hundred_columns() -> None:
    big = {"since": 1e5, "reach": (12345.678, 123.4567), "error": (99999.9, 999.9)}
    given = check_all(epochs(big, big, steps_m=np.full((2, 2), 12345.678), stamps_s=np.array([0.0, 12345.678, 0.0])))
    lines = check_lines("a-long-estimator", given, 20)
    assert max(map(len, lines)) <= 100
    assert len(lines) == 2 + len([check for check in CHECKS.values() if check.always])


def test_the_printed_table_shows_a_dash_for_what_there_is_not() -> None:
    line = next(line for line in check_lines("fused", check_all(epochs({})), 1) if line.startswith("subset_041_position"))
    assert set(line.split()[2:]) == {"-"}


def test_only_all_epochs_are_shown_as_a_hundred_percent() -> None:
    def shown(availability: float) -> list[str]:
        checks = {"subset_041_speed": {"availability": availability}}
        return next(line for line in check_lines("fused", checks, 1) if line.startswith("subset_041_speed")).split()[-2:]

    assert shown(0.99996) == ["99.99", "%"]
    assert shown(1.0) == ["100.00", "%"]
    assert shown(0.29) == ["29.00", "%"]


def test_figures_are_plain_numbers_in_json() -> None:
    given = check_all(epochs({"since": 1.0}, {}, steps_m=np.zeros((2, 2)), stamps_s=np.arange(2.0)))
    assert json.loads(json.dumps(given)) == given
