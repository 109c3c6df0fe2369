"""Figures from hand-made errors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from milepost.evaluation.plan import RequestedScore, epochs_within
from milepost.evaluation.scores import BASIC, SCORES, basic
from milepost.evaluation.summary import summary
from milepost.evaluation.trace import Trace, largest_difference_in_sigmas, trace_of_beliefs, trace_of_states

NOBODY: Any = SimpleNamespace(sensors={})


def trace(position: list[float], speed: list[float], **fields: Any) -> Trace:
    """Errors of one estimator, a second apart, on a train that runs at 10 m/s; variances 4, 1 and 1."""
    k = len(position)
    t = np.arange(k, dtype=float)
    truth = np.column_stack([10.0 * t, np.full(k, 10.0), np.zeros(k)])
    errors = np.column_stack([position, speed, np.zeros(k)])
    return Trace(t, truth + errors, np.tile(np.diag([4.0, 1.0, 1.0]), (k, 1, 1)), truth, **fields)


def figure(name: str, given: Trace, train: Any = NOBODY, **options: Any) -> Any:
    row = SCORES[name]
    return row.compute(given, train, row.options.model_validate(options))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("position_mean_m", 2.0),  # (1 + 3 + 2 + 2)/4
        ("position_std_m", np.sqrt(4.25)),  # mean -0.5; squares 2.25, 6.25, 2.25, 6.25
        ("position_rms_m", np.sqrt(4.5)),
        ("position_max_m", 3.0),
        ("position_final_m", 2.0),
        ("speed_mean_mps", 0.5),
        ("speed_std_mps", np.sqrt(0.5)),
        ("speed_rms_mps", np.sqrt(0.5)),
        ("speed_max_mps", 1.0),
        ("speed_max_kmh", 3.6),
        ("nees_mean", (18.0 / 4.0 + 2.0) / 4.0),
    ],
)
def test_a_figure_of_errors(name, expected):
    assert figure(name, trace([1.0, -3.0, 2.0, -2.0], [0.0, 1.0, 0.0, -1.0])) == pytest.approx(expected)


def test_the_basic_figures_count_speed_from_its_time_on():
    given = trace([1.0, -3.0], [5.0, 1.0])
    assert basic(given, 0.0)["speed_max_mps"] == 5.0
    assert basic(given, 0.5)["speed_max_mps"] == 1.0
    assert tuple(basic(given, 0.0)) == BASIC


def test_a_truth_outside_either_interval_is_counted_once():
    # truth: (0, 10), (10, 10), (20, 10), (30, 10)
    bounds = np.array([[-1, 1, 9, 11], [-1, 1, 9, 11], [19, 21, 11, 12], [0, 1, 0, 1]], dtype=float)
    assert figure("outside_interval", trace([0.0] * 4, [0.0] * 4, bounds=bounds)) == 0.75


def test_what_publishes_nothing_has_neither_interval_nor_rate_nor_wheel():
    given = trace([0.0, 0.0], [0.0, 0.0])
    assert figure("outside_interval", given) is None
    assert figure("refresh_hz", given) is None
    assert figure("longest_gap_s", given) is None
    assert figure("private_at_end", given, states=["a.scale"]) is None
    assert figure("diameter_error_percent_at_m", given, unit="a", at_m=[10.0]) is None


def test_the_rate_counts_intervals_between_states_and_the_gap_is_the_longest():
    given = trace([0.0], [0.0], sent_s=np.array([0.0, 0.02, 0.06, 0.08]))
    assert figure("refresh_hz", given) == pytest.approx(3 / 0.08)
    assert figure("longest_gap_s", given) == pytest.approx(0.04)


def test_the_error_over_a_gap_is_the_growth_not_the_size():
    assert figure("gap_error_m", trace([5.0, 7.0], [0.0] * 2), gaps={"2": [0.5, 2.5], "1": [-0.5, 0.5]}) == {}
    grown = figure("gap_error_m", trace([5.0, 5.0, 7.0, 4.0], [0.0] * 4), gaps={"1": [1.0, 2.0], "2": [1.0, 3.0]})
    assert grown == {"1": 2.0, "2": 1.0}


def test_a_wheels_diameter_is_compared_with_the_worn_one_where_the_train_then_is():
    wheel = SimpleNamespace(diameter_m=0.8, simulated=SimpleNamespace(diameter_m=1.0, wear_mps=0.01))
    train = SimpleNamespace(sensors={"odometer": SimpleNamespace(options=wheel)})
    # told 0.8: κ = 0.25 stands for 1.0 m. After 10 m (1 s) the wheel is 0.99 m, after 20 m 0.98 m; the run ends at 30 m
    given = trace([0.0] * 4, [0.0] * 4, private={"odometer.scale": np.full(4, 0.25)})
    off = figure("diameter_error_percent_at_m", given, train, unit="odometer", at_m=[10.0, 15.0, 99.0])
    assert off == pytest.approx({"10": 100.0 / 99.0, "15": 100.0 * 2.0 / 98.0})


def test_a_window_limits_a_figure_to_its_spans():
    given = trace([9.0, 1.0, 9.0, 2.0], [0.0] * 4)
    row = SCORES["position_max_m"]
    requested = RequestedScore("k", row, row.options(), [[1.0, 2.0], [3.0, 9.0]])
    assert requested.of(given, NOBODY, None) == 2.0
    assert RequestedScore("k", row, row.options(), [[50.0, 60.0]]).of(given, NOBODY, None) is None


def test_the_creep_window_is_wherever_any_wheel_creeps():
    creep = SimpleNamespace(at=lambda unit, t_s: 0.2 if unit == "rear" and 1.0 <= t_s < 3.0 else 0.0)
    train: Any = SimpleNamespace(sensors={"front": None, "rear": None})
    world: Any = SimpleNamespace(creep=creep)
    assert epochs_within("creep", trace([0.0] * 4, [0.0] * 4), train, world).tolist() == [False, True, True, False]


def test_estimators_are_compared_on_the_epochs_that_both_have():
    ours = trace_of_beliefs({0: ([9.0, 0, 0], np.eye(3)), 2: ([5.0, 0, 0], np.eye(3))}, {0: [0, 0, 0], 2: [0, 0, 0]}, 0)
    reference = trace_of_beliefs({2: ([1.0, 0, 0], np.diag([4.0, 1, 1]))}, {2: [0, 0, 0]}, 0)
    assert largest_difference_in_sigmas(ours, reference) == 2.0


def test_private_states_keep_their_names():
    belief = ([0.0, 0.0, 0.0, 0.5], np.diag([1.0, 1.0, 1.0, 9.0]))
    given = trace_of_beliefs({1: belief}, {1: [0, 0, 0]}, 0, ["position_m", "speed_mps", "acceleration_mps2", "imu.bias"])
    assert given.private["imu.bias"].tolist() == [0.5]
    assert given.private_std["imu.bias"].tolist() == [3.0]
    assert figure("private_at_end", given, states=["imu.bias"]) == [0.5]


def test_many_seeds_become_medians_and_the_worst_which_is_the_least_where_more_is_better():
    seeds = [
        {
            "scenario": "s",
            "seed": i,
            "duration_s": 1.0,
            "estimators": {"a": {"err": e, "hz": h, "map": {"10": e}, "list": [e, h]}},
        }
        for i, (e, h) in enumerate([(1.0, 50.0), (5.0, 40.0), (2.0, 45.0)])
    ]
    figures = summary(seeds, {"hz"})["estimators"]["a"]
    assert {key: figures[key] for key in ("err", "hz", "map", "list")} == {
        "err": 2.0, "hz": 45.0, "map": {"10": 2.0}, "list": [2.0, 45.0],
    }  # fmt: skip
    assert figures["worst"] == {"err": 5.0, "hz": 40.0, "map": {"10": 5.0}, "list": [5.0, 50.0]}


def test_private_states_that_go_back_with_every_other_state_are_there_at_every_epoch():
    head: Any = {"position_m": 0.0, "speed_mps": 0.0, "acceleration_mps2": 0.0, "covariance": np.eye(3), "sensors": []}
    head |= {"position_min_m": 0.0, "position_max_m": 0.0, "speed_min_mps": 0.0, "speed_max_mps": 0.0}
    head |= {"direction": "forward", "status": "normal", "last_balise": None}
    states: Any = {k: SimpleNamespace(**head, measured_at_ns=k, published_at_ns=k) for k in (0, 1, 2)}
    truth = {k: [0.0, 0.0, 0.0] for k in states}
    names = ["position_m", "speed_mps", "acceleration_mps2", "imu.bias"]
    given = trace_of_states(states, truth, 0, states, {0: ([1.0], [4.0]), 2: ([3.0], [16.0])}, names, {})
    assert given.private["imu.bias"].tolist() == [1.0, 2.0, 3.0]
    assert given.private_std["imu.bias"].tolist() == [2.0, 3.0, 4.0]
    # the sources' rule sends the common states back alone
    assert trace_of_states(states, truth, 0, states, {}, names, {}).private == {}
