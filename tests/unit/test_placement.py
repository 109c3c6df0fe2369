"""A misplaced balise, by hand: sections between balises, and which of them name one."""

from __future__ import annotations

from statistics import NormalDist

import pytest

from milepost.track.line import Balise, Line
from milepost.track.placement import FALSE_ALARM, LIMIT_SIGMAS, Belief, Placement

S = 1_000_000_000
T0 = 1_700_000_000 * S
LINE = Line("l", 1000.0, tuple(Balise(f"b{i}", 100.0 * i, 0.05) for i in range(1, 8)), map_accuracy_m=0.02)
# P₂⁻ + R₂ + P₁⁺ + R₁ = 0.0081 + 0.0004 + 0.0011 + 0.0004 = 0.01: σ = 0.1 m; the map leaves 0.05 + 0.05 + 0.02 = 0.12 m open
BEFORE_M2, AFTER_M2, READER_M2 = 0.0081, 0.0011, 0.0004
SURELY_M = 0.12 + LIMIT_SIGMAS * 0.1


def belief(at_s: float, position_m: float, variance_m2: float) -> Belief:
    at_ns = T0 + round(at_s * S)
    return Belief(at_ns, [position_m, 0.0, 0.0], [[variance_m2, 0.0, 0.0], [0.0, 1e-12, 0.0], [0.0, 0.0, 1e-12]])


def travel(excesses_m: list[float], numbers: list[int] | None = None) -> list[str]:
    """Pass balises whose mapped distance is longer than the travelled one by so much; returns the texts of the events."""
    numbers = numbers or list(range(1, len(excesses_m) + 2))
    placement, said = Placement(LINE), []
    for k, number in enumerate(numbers):
        at_m = 100.0 * number
        if k:
            # the fix before put the state where the map has that balise
            at_m -= excesses_m[k - 1]
        t_s = 10.0 * k
        first = belief(t_s, at_m, BEFORE_M2)
        placement.believe(first, first.at_ns)
        found = placement.passed(number - 1, first.at_ns, READER_M2, first.at_ns)
        said += [found.text] if found else []
        entered = belief(t_s + 0.1, 100.0 * number, AFTER_M2)
        placement.believe(entered, entered.at_ns)
    return said


def test_the_position_is_carried_with_the_covariance() -> None:
    known = Belief(T0, [10.0, 20.0, 2.0], [[1.0, 0.5, 0.0], [0.5, 4.0, 0.0], [0.0, 0.0, 0.0]])
    # 10 + 20/2 + 2/8; 1 + 2 · 0.5/2 + 4/4
    assert known.position_at(T0 + S // 2) == pytest.approx((20.25, 2.5))


def test_the_limit_follows_from_the_false_alarm_probability() -> None:
    outside = 2.0 * (1.0 - NormalDist().cdf(LIMIT_SIGMAS))
    assert 0.5 * outside**2 == pytest.approx(FALSE_ALARM)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_balise_that_both_neighbours_contradict_is_named_with_its_offset(sign: float) -> None:
    (text,) = travel([0.01, sign * 1.0, -sign * 1.2, sign * 0.1])
    side = "beyond" if sign > 0 else "short of"
    assert text == f"the line has b3 at 300.00 m, 1.00 ± 0.10 m {side} its place, by the distances from b2 and b4"


def test_a_train_that_goes_back_names_the_same_balise() -> None:
    # the mapped distances are negative: what is mapped too far is passed too early
    (text,) = travel([0.01, 1.0, -1.0], [7, 6, 5, 4])
    assert "b5" in text
    assert "1.00 ± 0.10 m beyond its place" in text


def test_a_balise_barely_within_the_limit_is_not_named() -> None:
    assert travel([0.0, SURELY_M - 0.001, -1.0]) == []
    assert travel([0.0, 1.0, -(SURELY_M - 0.001)]) == []
    assert len(travel([0.0, SURELY_M + 0.001, -(SURELY_M + 0.001)])) == 1


def test_a_wrong_travelled_distance_names_no_balise() -> None:
    assert travel([0.0, 3.0, 0.0, 0.0]) == []
    assert travel([0.0, 3.0, 3.0, 0.0]) == []


def test_excesses_of_very_different_size_name_no_balise() -> None:
    assert travel([0.0, 10.0, -1.0, 0.0]) == []
    assert travel([0.0, 1.0, -10.0, 0.0]) == []


def test_a_bent_state_behind_a_misplaced_balise_names_no_other() -> None:
    # a state that takes the whole offset for an error of scale: e, -2 e, e, -e/2 ...
    assert len(travel([0.0, 3.0, -6.0, 3.0, -1.5, 0.7])) == 1


def test_a_missing_balise_leaves_its_neighbours_unjudged() -> None:
    assert travel([0.0, 1.0, -1.0], [1, 2, 4, 5]) == []


def test_a_state_without_the_fix_is_no_beginning_of_a_section() -> None:
    placement = Placement(LINE)
    for k, at_m in enumerate((100.0, 200.0, 299.0, 401.0)):
        known = belief(10.0 * k, at_m, BEFORE_M2)
        placement.believe(known, known.at_ns)
        assert placement.passed(k, known.at_ns, READER_M2, known.at_ns) is None


def test_a_state_older_than_the_last_one_is_not_used() -> None:
    placement = Placement(LINE)
    for k, (early_m, late_m) in enumerate(((0.0, 100.0), (0.0, 200.0), (-50.0, 300.0), (50.0, 400.0))):
        for known in (belief(10.0 * k, late_m, BEFORE_M2), belief(10.0 * k - 0.5, late_m + early_m, BEFORE_M2)):
            placement.believe(known, known.at_ns)
        assert placement.passed(k, T0 + 10 * k * S, READER_M2, T0 + 10 * k * S) is None
        entered = belief(10.0 * k + 0.1, late_m, AFTER_M2)
        placement.believe(entered, entered.at_ns)
