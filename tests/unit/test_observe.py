"""What `up --report` says, computed by hand."""

from __future__ import annotations

from typing import Any

import pytest

from examples import EXAMPLES, head
from milepost.checks.observer import summarise
from milepost_schemas import FusedState, Truth

MS = 1_000_000
T0 = 1_700_000_000_000 * MS
EPOCH0 = 85_000_000_000


def state(k: int, position: float = 100.0, speed: float = 20.0, **changed: Any) -> FusedState:
    """The state of the k-th epoch, with an interval of ±2 m and ±1 m/s."""
    example = EXAMPLES["state"][0].model_dump()
    changes = {
        **head("fuser", measured_at_ns=T0 + 20 * k * MS, sequence=k),
        "epoch": EPOCH0 + k,
        "position_m": position,
        "position_min_m": position - 2.0,
        "position_max_m": position + 2.0,
        "speed_mps": speed,
        "speed_min_mps": speed - 1.0,
        "speed_max_mps": speed + 1.0,
        **changed,
    }
    return FusedState.model_validate({**example, **changes})


def truth(k: int, position: float = 100.0, speed: float = 20.0) -> Truth:
    return Truth(**head("world", measured_at_ns=T0 + 20 * k * MS), position_m=position, speed_mps=speed, acceleration_mps2=0.0)


def received(states: list[FusedState], ages_ms: list[float] | None = None) -> list[tuple[FusedState, int]]:
    ages = ages_ms or [5.0] * len(states)
    return [(s, s.measured_at_ns + round(age * MS)) for s, age in zip(states, ages, strict=True)]


def by_time(truths: list[Truth]) -> dict[int, Truth]:
    return {t.measured_at_ns: t for t in truths}


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_states_are_said_to_be_so(count: int) -> None:
    found = summarise(received([state(k) for k in range(count)]), {}, [])
    assert found["states"] == count
    assert "fewer than two" in found["error"]


def test_rate_gaps_and_ages_are_those_of_receipt() -> None:
    # received at 5, 25, 48, 65, 85 ms after T0
    found = summarise(received([state(k) for k in range(5)], [5.0, 5.0, 8.0, 5.0, 5.0]), {}, [])
    assert found["states"] == 5
    assert found["duration_s"] == pytest.approx(0.080)
    assert found["rate_hz"] == pytest.approx(4 / 0.080)
    # gaps 20, 23, 17, 20 ms
    assert found["gap_ms"]["median"] == pytest.approx(20.0)
    assert found["gap_ms"]["max"] == pytest.approx(23.0)
    assert found["gap_ms"]["p99"] == pytest.approx(20.0 + 0.97 * 3.0)
    assert found["age_ms"]["p50"] == pytest.approx(5.0)
    assert found["age_ms"]["max"] == pytest.approx(8.0)
    assert found["epochs_missing"] == 0
    assert found["gaps_over_60ms"] == []
    assert found["gaps_over_60ms_unexplained"] == 0
    assert found["stall_max_ms"] == 0.0
    assert found["truth"] is None


def test_epochs_that_never_came_are_missing_and_those_that_came_twice_are_not_counted_against_it() -> None:
    found = summarise(received([state(k) for k in (0, 1, 1, 4, 5)]), {}, [])
    assert found["epochs_missing"] == 2


def test_statuses_are_counted() -> None:
    states = [state(0, status="initialising"), state(1), state(2), state(3, status="coasting")]
    assert summarise(received(states), {}, [])["statuses"] == {"coasting": 1, "initialising": 1, "normal": 2}


def test_a_long_gap_is_explained_only_by_a_stall_of_the_machine_during_it() -> None:
    # received at 5, 25, 125 (gap of 100 ms), 145, 305 (gap of 160 ms)
    states = received([state(k) for k in (0, 1, 6, 7, 15)])
    # ended 90 ms after T0 and lasted 50 ms: from 40 to 90, inside the first long gap; the other is long past
    stalls = [(T0 + 40 * MS, T0 + 90 * MS), (T0 + 1700 * MS, T0 + 2000 * MS)]
    found = summarise(states, {}, stalls)
    first, second = found["gaps_over_60ms"]
    assert (first["gap_ms"], first["stall_ms"]) == pytest.approx((100.0, 50.0))
    assert first["at_ns"] == T0 + 25 * MS
    assert (second["gap_ms"], second["stall_ms"]) == pytest.approx((160.0, 0.0))
    assert found["gaps_over_60ms_unexplained"] == 1
    assert found["stall_max_ms"] == 300.0


def test_a_stall_too_short_for_the_gap_does_not_explain_it_and_several_add_up() -> None:
    states = received([state(k) for k in (0, 6)])
    short = (T0 + 20 * MS, T0 + 50 * MS)
    assert summarise(states, {}, [short])["gaps_over_60ms_unexplained"] == 1
    assert summarise(states, {}, [short, (T0 + 60 * MS, T0 + 90 * MS)])["gaps_over_60ms_unexplained"] == 0


def test_a_gap_of_exactly_60_milliseconds_is_none() -> None:
    assert summarise(received([state(k) for k in (0, 3)]), {}, [])["gaps_over_60ms"] == []


def test_errors_are_against_the_truth_of_the_same_epoch() -> None:
    states = received([state(0, 101.0, 20.5), state(1, 100.0, 19.5), state(2, 97.0, 20.0), state(3, 500.0)])
    truths = by_time([truth(k) for k in range(3)])
    found = summarise(states, truths, [])["truth"]
    assert found["compared"] == 3
    assert found["position_rms_m"] == pytest.approx(((1 + 0 + 9) / 3) ** 0.5)
    assert found["position_max_m"] == pytest.approx(3.0)
    assert found["speed_rms_mps"] == pytest.approx((0.5 / 3) ** 0.5)
    assert found["speed_max_mps"] == pytest.approx(0.5)
    assert found["outside_interval"] == 1
    assert found["outside_speed_interval"] == 0


def test_a_truth_on_the_edge_of_an_interval_is_inside_it() -> None:
    states = received([state(k) for k in range(4)])
    found = summarise(states, by_time([truth(0, 102.0), truth(1, 98.0), truth(2, 102.001), truth(3, 97.999, 21.001)]), [])
    assert found["truth"]["outside_interval"] == 2
    assert found["truth"]["outside_speed_interval"] == 1


def test_errors_count_from_the_first_balise_on_but_intervals_from_the_start() -> None:
    states = received([state(0, 150.0, last_balise=None), state(1, 101.0), state(2, 101.0)])
    found = summarise(states, by_time([truth(k) for k in range(3)]), [])["truth"]
    assert found["compared"] == 3
    assert found["outside_interval"] == 1
    assert found["position_max_m"] == pytest.approx(1.0)


def test_without_any_balise_all_errors_count() -> None:
    states = received([state(k, 103.0, last_balise=None) for k in range(2)])
    assert summarise(states, by_time([truth(0), truth(1)]), [])["truth"]["position_rms_m"] == pytest.approx(3.0)


def test_the_report_is_plain_json() -> None:
    import json

    states = received([state(k) for k in (0, 1, 6)])
    found = summarise(states, by_time([truth(0)]), [(T0 + 40 * MS, T0 + 90 * MS)])
    assert json.loads(json.dumps(found)) == found
