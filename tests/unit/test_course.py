"""What an excluded unit is found to do while it is watched: its error stays, grows, or comes and goes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from banks import T0, Fault, Ride, between, bias, noisy, receiver, scaled_layout, speedometer, stuck, true_speed, wheel
from milepost.estimation.time_units import NS_PER_S
from milepost.fusion.course import AGAIN_NS, BLOCK, Course
from milepost.fusion.verdicts import Verdict

TRAIN = Ride((speedometer("first"), speedometer("second", phase_s=0.025), receiver()))
WITH_WHEEL = Ride((speedometer("first"), wheel(), receiver()), scaled_layout())
FROM_S, END_S = 10.0, 45.0
each_seed = pytest.mark.parametrize("seed", [1, 2, 3])


def growing(rate: float) -> Fault:
    """Reads more by so much per second."""
    return between(FROM_S, END_S, lambda t, z, _: z + rate * (t - FROM_S))


def on_and_off(size: float, period_s: float) -> Fault:
    """Reads so much more in the first half of each period."""
    return between(FROM_S, END_S, lambda t, z, _: z + size * ((t - FROM_S) % period_s < 0.5 * period_s))


def verdicts(fault: Fault, unit: str = "first", seed: int = 1, train: Ride = TRAIN) -> list[Verdict]:
    """The verdicts on a unit after each of its readings while it is excluded."""
    moments = replace(train, seed=seed).moments(END_S, {unit: fault})
    found = (m.bank.verdicts[unit] for m in moments if m.unit == unit)
    return [verdict for verdict in found if verdict.excluded is not None]


def kinds(fault: Fault, unit: str = "first", seed: int = 1, train: Ride = TRAIN) -> set[str | None]:
    return {verdict.kind for verdict in verdicts(fault, unit, seed, train)}


@each_seed
@pytest.mark.parametrize("rate", [0.02, 0.05, -0.05])
def test_an_error_that_grows_is_called_drifting(rate: float, seed: int) -> None:
    found = verdicts(growing(rate), seed=seed)
    assert found[0].kind in ("biased", "jumping")
    assert found[-1].kind == "drifting"
    assert "its error grew from " in found[-1].evidence


@each_seed
@pytest.mark.parametrize("size", [0.2, 0.5, -1.0, 3.0])
def test_an_error_that_stays_is_never_called_drifting_or_intermittent(size: float, seed: int) -> None:
    assert not kinds(between(FROM_S, END_S, bias(size)), seed=seed) & {"drifting", "intermittent"}


@each_seed
@pytest.mark.parametrize("factor", [3.0, 6.0])
def test_a_noisy_unit_is_given_no_other_name_by_its_course(factor: float, seed: int) -> None:
    assert kinds(between(FROM_S, END_S, noisy(factor)), seed=seed) <= {"noisy", "jumping"}


@each_seed
@pytest.mark.parametrize("period_s", [2.0, 8.0])
def test_an_error_that_comes_and_goes_is_called_intermittent(period_s: float, seed: int) -> None:
    found = verdicts(on_and_off(1.0, period_s), seed=seed)
    assert found[0].kind != "intermittent"
    assert found[-1].kind == "intermittent"
    assert "it was wrong 3 times within " in found[-1].evidence


def test_an_error_that_comes_twice_is_not_yet_intermittent() -> None:
    twice = between(FROM_S, FROM_S + 8.0, on_and_off(1.0, 4.0))
    found = verdicts(twice)
    assert len({v.excluded.at_ns for v in found if v.excluded}) == 2
    assert "intermittent" not in {v.kind for v in found}


@each_seed
def test_a_step_that_looks_like_noise_is_soon_called_biased(seed: int) -> None:
    found = verdicts(between(FROM_S, END_S, bias(1.0)), seed=seed)
    assert found[-1].kind in ("biased", "jumping")
    if found[0].kind == "noisy":
        assert "its last 3 means" in found[-1].evidence


def test_a_stuck_unit_stays_stuck_while_the_train_accelerates() -> None:
    assert kinds(between(FROM_S, END_S, stuck(true_speed(FROM_S)))) == {"stuck"}


def test_a_wheel_that_slips_more_and_more_is_not_called_drifting() -> None:
    slip = between(FROM_S, END_S, lambda t, z, _: z * (1.0 + 0.05 * (1.0 + (t - FROM_S) / 10.0)))
    assert kinds(slip, "wheel", train=WITH_WHEEL) == {"spinning"}


def watched(course: Course, es: list[float], from_s: float, hz: float = 10.0) -> Course:
    """The course after innovations in σ at a rate."""
    for number, e in enumerate(es):
        course = course.heard(T0 + round((from_s + number / hz) * NS_PER_S), e)
    return course


def test_the_second_row_of_a_reading_says_nothing_more() -> None:
    course = Course().excluded(T0, sudden=False)
    once = watched(course, [5.0] * BLOCK, 0.1)
    twice = course
    for number in range(BLOCK):
        at_ns = T0 + round((0.1 + number / 10.0) * NS_PER_S)
        twice = twice.heard(at_ns, 5.0).heard(at_ns, 50.0)
    assert twice == once


def test_errors_that_are_far_apart_are_not_intermittent() -> None:
    course, apart_s = Course(), 0.6e-9 * AGAIN_NS
    for number in range(6):
        at_s = number * apart_s
        course = course.excluded(T0 + round(at_s * NS_PER_S), sudden=True)
        course = watched(course, [5.0] * 20, at_s + 0.1)
    assert course.kind != "intermittent"
