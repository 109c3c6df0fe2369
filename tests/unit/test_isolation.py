"""Liars on a train in pure numbers: found, left out exactly, readmitted when they agree; the interval holds throughout."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from banks import (
    MEAN,
    STD,
    Fault,
    Moment,
    Ride,
    between,
    bias,
    noisy,
    reader,
    receiver,
    scale,
    scaled_layout,
    speedometer,
    stuck,
    true_speed,
    wheel,
)
from milepost.estimation.layout import Layout
from milepost.fusion.evidence import REPEATS
from milepost.fusion.isolation import SOFT

FIRST, SECOND = speedometer("first"), speedometer("second", phase_s=0.025)
TRAIN = Ride((FIRST, SECOND, receiver()))
WITH_BALISES = Ride((FIRST, SECOND, reader()))
ALONE = Ride((FIRST, SECOND))
WITH_WHEEL = Ride((FIRST, wheel(), receiver()), scaled_layout())
FROM_S, TO_S, END_S = 10.0, 20.0, 36.0
NOBODY: frozenset[str] = frozenset()
# the sensors' noise: 0.1 m/s and 0.5 m
LIARS: dict[str, tuple[str, Fault, float]] = {
    "bias": ("first", bias(0.5), 1.0),
    "jump": ("receiver", bias(20.0), 2.0),
    "noise": ("second", noisy(6.0), 2.0),
    "stuck": ("first", stuck(true_speed(FROM_S)), 2.0),
}


def leading(moment: Moment) -> tuple[np.ndarray, np.ndarray]:
    """The mean and covariance that are published."""
    return TRAIN.kernel().unpack(moment.bank)


def at(moments: list[Moment], t_s: float) -> Moment:
    """The last moment until then."""
    return [m for m in moments if m.t_s <= t_s][-1]


def changes(moments: list[Moment]) -> list[tuple[float, frozenset[str]]]:
    """When other units than before are excluded, and which."""
    out = [(0.0, NOBODY)]
    for moment in moments:
        if moment.excluded != out[-1][1]:
            out.append((moment.t_s, moment.excluded))
    return out[1:]


def in_sigmas(one: Moment, other: Moment) -> float:
    """The largest difference of the published common states, in standard deviations."""
    (x, P), (y, _) = leading(one), leading(other)
    return float(np.max(np.abs(x[:3] - y[:3]) / np.sqrt(np.diag(P)[:3])))


@cache
def ridden(kind: str, seed: int) -> tuple[Moment, ...]:
    unit, fault, _ = LIARS[kind]
    return tuple(replace(TRAIN, seed=seed).moments(END_S, {unit: between(FROM_S, TO_S, fault)}))


each_liar = pytest.mark.parametrize("kind", LIARS)
each_seed = pytest.mark.parametrize("seed", [1, 2, 3])


@each_liar
@each_seed
def test_a_liar_is_left_out_in_time_and_nobody_else(kind: str, seed: int) -> None:
    unit, _, within_s = LIARS[kind]
    found = changes(list(ridden(kind, seed)))
    assert found[0][1] == {unit}
    assert FROM_S <= found[0][0] <= FROM_S + within_s
    assert {units for _, units in found} == {frozenset((unit,)), NOBODY}


@each_liar
@each_seed
def test_the_interval_holds_the_truth_before_during_and_after(kind: str, seed: int) -> None:
    assert [m.t_s for m in ridden(kind, seed) if not m.holds()] == []


@each_liar
@each_seed
def test_a_liar_that_agrees_again_is_readmitted_once(kind: str, seed: int) -> None:
    found = changes(list(ridden(kind, seed)))
    assert len(found) == 2
    assert TO_S < found[1][0] < TO_S + 3.0


@each_liar
def test_the_published_belief_never_heard_the_excluded(kind: str) -> None:
    """It is that of the same train without the unit, also where the unit is heard first.

    The prior of that train is wider by the way that the train has moved until the others are heard.
    """
    unit, fault, _ = LIARS[kind]
    with_it = list(TRAIN.moments(END_S, {unit: between(FROM_S, END_S, fault)}))
    others = tuple(d for d in TRAIN.devices if d.unit != unit)
    late_s = min(d.phase_s for d in others) - min(d.phase_s for d in TRAIN.devices)
    prior_std = (math.hypot(STD[0], MEAN[1] * late_s), STD[1], STD[2])
    without = list(replace(TRAIN, devices=others, prior_std=prior_std).moments(END_S))
    for t_s in (FROM_S + 3.0, FROM_S + 7.0, TO_S):
        assert at(with_it, t_s).excluded == {unit}
        one, other = (next(m for m in reversed(run) if m.t_s <= t_s and m.unit != unit) for run in (with_it, without))
        assert one.t_s == other.t_s
        assert in_sigmas(one, other) < 1e-9


@each_liar
def test_readmission_goes_on_from_the_belief_without_the_unit(kind: str) -> None:
    """The unit's next reading moves it by no more than the belief is uncertain."""
    moments = list(ridden(kind, 1))
    back = next(i for i, m in enumerate(moments) if m.t_s > TO_S and not m.excluded)
    (x, P), (y, _) = leading(moments[back - 1]), leading(moments[back])
    assert np.all(np.abs(y - x)[:2] < 3.0 * np.sqrt(np.diag(P))[:2] + [0.5, 0.0])
    assert in_sigmas(moments[-1], list(TRAIN.moments(END_S))[-1]) < 1.0


def test_a_train_without_liars_excludes_nobody() -> None:
    for seed in range(1, 6):
        moments = list(replace(TRAIN, seed=seed).moments(60.0))
        assert changes(moments) == []
        assert all(m.holds() and not m.bank.doubted for m in moments)


def test_a_unit_that_repeats_itself_is_stuck_although_it_is_right() -> None:
    moments = list(TRAIN.moments(14.0, {"first": between(FROM_S, TO_S, stuck(true_speed(FROM_S) + 0.05))}))
    (found_s, units), *_ = changes(moments)
    assert units == {"first"}
    assert found_s <= FROM_S + REPEATS / 20.0 + 1e-9
    verdict = at(moments, found_s).bank.verdicts["first"]
    assert verdict.excluded is not None
    assert verdict.excluded.kind == "stuck"


# --- wheels


@pytest.mark.parametrize("from_s", [0.0, FROM_S], ids=["from the start", "later"])
def test_a_wheel_of_1440_mm_is_refused_and_heals(from_s: float) -> None:
    """Told 850 mm ± 1 %, it reads 1.69 times the speed."""
    moments = list(WITH_WHEEL.moments(END_S, {"wheel": between(from_s, TO_S, scale(1440.0 / 850.0))}))
    assert [units for _, units in changes(moments)] == [{"wheel"}, NOBODY]
    assert changes(moments)[0][0] < from_s + 0.2
    assert all(m.holds() for m in moments)
    # what is published of the wheel's scale was never near 0.69, and in the end is right
    assert max(abs(leading(m)[0][3]) for m in moments) < 0.02
    mean, covariance = leading(moments[-1])
    assert abs(mean[3]) < min(0.005, 4.0 * float(np.sqrt(covariance[3, 3])))


def test_with_the_wheel_refused_the_row_without_it_is_published() -> None:
    faults = {"wheel": between(0.0, 1e9, scale(1440.0 / 850.0))}
    moments = list(WITH_WHEEL.moments(FROM_S, faults))
    others = tuple(d for d in WITH_WHEEL.devices if d.unit != "wheel")
    without = list(Ride(others, Layout()).moments(FROM_S))
    ours = next(m for m in reversed(moments) if m.unit != "wheel")
    assert ours.excluded == {"wheel"}
    assert ours.t_s == without[-1].t_s
    assert in_sigmas(ours, without[-1]) < 1e-9


def test_a_scale_that_grows_slowly_is_refused_before_it_leaves_its_prior() -> None:
    """A scale that may wander follows at first; no wheel is 6 % off, and the truth stays in the interval."""
    free = replace(WITH_WHEEL, layout=scaled_layout(noise_psd=1e-5))
    moments = list(free.moments(60.0, {"wheel": between(FROM_S, 40.0, lambda t, z, _: z * (1.0 + 0.005 * (t - FROM_S)))}))
    assert [units for _, units in changes(moments)] == [{"wheel"}, NOBODY]
    assert all(m.holds() for m in moments)
    limit = free.doubts().threshold
    assert max(abs(leading(m)[0][3]) for m in moments) < limit * 0.01
    assert abs(leading(moments[-1])[0][3]) < 0.01


def test_a_lie_that_is_found_at_once_is_no_step_of_the_state() -> None:
    """Nothing that was published held it."""
    moments = list(WITH_WHEEL.moments(12.0, {"wheel": between(FROM_S, TO_S, scale(1440.0 / 850.0))}))
    place = next(i for i, m in enumerate(moments) if m.excluded)
    (x, _), (y, P) = leading(moments[place - 1]), leading(moments[place])
    assert np.all(np.abs(y - x)[:2] < np.add(np.sqrt(np.diag(P))[:2], [20.0 * 0.02, 0.0]))
    assert moments[place].bank.reset is None


def test_a_step_beyond_the_states_own_uncertainty_is_announced() -> None:
    """A slow liar has taken the state with it until it is found."""
    drift = between(FROM_S, 30.0, lambda t, z, _: z + 0.02 * (t - FROM_S))
    moments = list(TRAIN.moments(25.0, {"first": drift}))
    resets = {m.bank.reset for m in moments} - {None}
    assert resets
    for reset in resets:
        after = next(i for i, m in enumerate(moments) if m.bank.reset == reset)
        (x, _), (y, P) = leading(moments[after - 1]), leading(moments[after])
        assert reset is not None
        assert abs(reset.size_mps) > 2.0 * np.sqrt(P[1, 1]) or abs(reset.size_m) > 2.0 * np.sqrt(P[0, 0])
        # between these two lies a twentieth of a second, and a reading that is honest
        assert y[1] - x[1] == pytest.approx(reset.size_mps, abs=2.0 * float(np.sqrt(P[1, 1])))


def slipping(ratio: float) -> Fault:
    """Adhesion breaks within half a second."""
    return between(FROM_S, TO_S, lambda t, z, _: z * (1.0 + ratio * min(1.0, 2.0 * (t - FROM_S))))


@pytest.mark.parametrize(("ratio", "kind"), [(0.1, "spinning"), (-0.1, "sliding")])
def test_a_wheel_that_slips_keeps_its_diameter(ratio: float, kind: str) -> None:
    moments = list(WITH_WHEEL.moments(END_S, {"wheel": slipping(ratio)}))
    (found_s, units), (back_s, _) = changes(moments)
    assert units == {"wheel"}
    found, back = at(moments, found_s), at(moments, back_s)
    verdict = found.bank.verdicts["wheel"].excluded
    assert verdict is not None
    assert verdict.kind == kind
    before = [m for m in moments if m.t_s < found_s][-1]
    (x, P), (y, R) = leading(before), leading(found)
    # as it was before the reading that told, twice as uncertain, and independent of what never heard it
    assert y[3] == pytest.approx(x[3], abs=1e-6)
    assert R[3, 3] == pytest.approx(4.0 * P[3, 3], rel=1e-3)
    assert np.abs(R[3, :3]).max() == 0.0
    assert abs(leading(back)[0][3] - x[3]) < 4.0 * np.sqrt(R[3, 3])
    assert all(m.holds() for m in moments)


def test_all_wheels_that_slip_together_are_left_out_together() -> None:
    blocks = (*scaled_layout().blocks, *scaled_layout("other").blocks)
    devices = (FIRST, wheel(), wheel("other", phase_s=0.041), receiver())
    train = Ride(devices, Layout(blocks), ((frozenset(("wheel", "other")), 3e-3),))
    moments = list(train.moments(END_S, {"wheel": slipping(-0.2), "other": slipping(-0.2)}))
    found = changes(moments)
    assert {"wheel", "other"} in [units for _, units in found]
    assert all(units <= {"wheel", "other"} for _, units in found)
    assert found[-1][1] == NOBODY
    assert all(m.holds() for m in moments)


# --- odd readings


def test_a_lone_odd_fix_is_refused_and_takes_nothing_with_it() -> None:
    odd = between(FROM_S, FROM_S + 1.0, bias(10.0))
    moments = list(WITH_BALISES.moments(END_S, {"reader": between(9.5, 11.5, odd)}))
    silent = list(WITH_BALISES.moments(END_S, {"reader": between(FROM_S, FROM_S + 1.0, lambda *_: None)}))
    assert changes(moments) == []
    fixes = [m for m in moments if m.unit == "reader"]
    refused = [m for m in fixes if m.bank.verdicts["reader"].refused is not None]
    assert [m.t_s for m in refused] == [pytest.approx(10.017)]
    assert refused[0].bank.verdicts["reader"].refused == "does not fit"
    assert moments[-1].bank.verdicts["reader"].odd_ns == (refused[0].bank.verdicts["reader"].heard_ns,)
    # but for an interval that is predicted in two steps, the belief is that of a train without this fix
    assert in_sigmas(moments[-1], silent[-1]) < 1e-9
    assert all(m.holds() for m in moments)


def test_two_odd_fixes_in_a_row_exclude_the_reader() -> None:
    moments = list(WITH_BALISES.moments(END_S, {"reader": between(FROM_S, FROM_S + 3.0, bias(10.0))}))
    times, units = zip(*changes(moments), strict=True)
    assert times == pytest.approx((12.017, 16.017))
    assert units == ({"reader"}, NOBODY)
    silent = list(WITH_BALISES.moments(14.0, {"reader": lambda *_: None}))
    assert at(moments, silent[-1].t_s).unit == silent[-1].unit
    assert in_sigmas(at(moments, silent[-1].t_s), silent[-1]) < 1e-9
    assert all(m.holds() for m in moments)


# --- contradictions


def test_two_that_contradict_each_other_stay_doubted_without_a_third() -> None:
    """The first drifts off by 0.4 m/s within 20 s, as slowly as a train may; the interval holds what both say."""
    drift = between(FROM_S, 1e9, lambda t, z, _: z + min(0.4, 0.02 * (t - FROM_S)))
    moments = list(ALONE.moments(60.0, {"first": drift}))
    assert changes(moments) == []
    since_s = next(m.t_s for m in moments if m.bank.doubted)
    assert FROM_S < since_s < FROM_S + 15.0
    later = [m for m in moments if m.t_s >= since_s]
    assert {m.bank.doubted for m in later} == {("first", "second")}
    assert all(m.holds() for m in moments)
    for m in later:
        (slow, fast), truth = m.intervals()[1], true_speed(m.t_s)
        assert slow < truth < fast
        assert slow < truth + min(0.4, 0.02 * (m.t_s - FROM_S)) < fast


def test_a_third_unit_tells_which_of_two_lies() -> None:
    drift = between(FROM_S, 30.0, lambda t, z, _: z + 0.02 * (t - FROM_S))
    moments = list(TRAIN.moments(40.0, {"first": drift}))
    assert [units for _, units in changes(moments)] == [{"first"}, NOBODY]
    assert any(m.bank.doubted == ("first", "second") for m in moments)
    assert not any(m.bank.doubted for m in moments if m.excluded)
    assert all(m.holds() for m in moments)


@pytest.mark.parametrize(
    ("train", "unit", "fault"),
    [
        (TRAIN, "first", lambda t, z, _: z + 0.02 * (t - FROM_S)),
        (replace(WITH_WHEEL, layout=scaled_layout(noise_psd=1e-5)), "wheel", lambda t, z, _: z * (1.0 + 0.005 * (t - FROM_S))),
    ],
    ids=["speed", "wheel"],
)
def test_the_evidence_of_an_exclusion_is_beyond_the_limit(train: Ride, unit: str, fault: Fault) -> None:
    """Also where another unit's reading told, against another hypothesis than the leading one."""
    moments = list(train.moments(30.0, {unit: between(FROM_S, 1e9, fault)}))
    verdict = next(m for m in moments if m.excluded).bank.verdicts[unit].excluded
    assert verdict is not None
    assert verdict.found_by == "receiver"
    assert verdict.value > SOFT * train.doubts().threshold


# --- relapses, and too many liars


def test_each_relapse_doubles_the_probation() -> None:
    off = between(FROM_S, 1e9, lambda t, z, _: z + 0.8 if t % 20.0 < 3.0 else z)
    found = changes(list(TRAIN.moments(100.0, {"first": off})))
    out = [t_s for t_s, units in found if units == {"first"}]
    back = [t_s for t_s, units in found if not units]
    # the last reading that disagrees comes at 22.95 s, 42.95 s and so on
    waited = [t_s - (20.0 * (i + 1) + 2.95) for i, t_s in enumerate(back)]
    assert len(out) == len(back) == 4
    assert waited == pytest.approx([1.0, 2.0, 4.0, 8.0], abs=0.3)


def test_a_unit_that_still_disagrees_a_little_stays_out() -> None:
    """3 σ alone would exclude nobody at once, but readmits nobody either."""
    moments = list(TRAIN.moments(30.0, {"first": lambda t, z, _: z + (0.0 if t < 10.0 else 0.6 if t < 12.0 else 0.3)}))
    assert len(changes(moments)) == 1
    assert at(moments, 11.9).excluded == at(moments, 30.0).excluded == {"first"}


def test_with_every_unit_lying_the_bank_predicts_and_excludes_all() -> None:
    """Each is found at once, so that nothing published held a lie."""
    faults = {
        "first": between(FROM_S, TO_S, bias(3.0)),
        "second": between(FROM_S, TO_S, bias(-2.0)),
        "receiver": between(FROM_S, TO_S, bias(40.0)),
    }
    moments = list(TRAIN.moments(END_S, faults))
    lost = at(moments, TO_S - 1.0)
    assert lost.excluded == {"first", "second", "receiver"}
    assert np.isfinite(leading(lost)[0]).all()
    assert all(m.holds() for m in moments)
    assert moments[-1].excluded == NOBODY


def test_two_liars_at_once_are_left_out_without_a_restart() -> None:
    """While nothing tells which of two drifts, the third jumps: one row heard neither."""
    train = Ride((FIRST, SECOND, receiver(std=20.0)))
    faults = {
        "first": between(FROM_S, 30.0, lambda t, z, _: z + 0.02 * (t - FROM_S)),
        "receiver": between(22.0, 26.0, bias(-300.0)),
    }
    moments = list(train.moments(50.0, faults))
    assert at(moments, 21.9).bank.doubted == ("first", "second")
    (found_s, units), *_ = changes(moments)
    assert units == {"first", "receiver"}
    reset = at(moments, found_s).bank.reset
    assert reset is None or reset.reason == "excluded: first, receiver"
    assert all(m.holds() for m in moments)
    assert moments[-1].excluded == NOBODY
    assert moments[-1].bank.doubted == ()


def test_where_no_hypothesis_is_left_the_bank_starts_again() -> None:
    """While nothing tells which of two drifts, both others jump: three liars at once are more than any row leaves out."""
    others = receiver(std=20.0), replace(receiver("other", std=20.0), phase_s=0.02)
    train = Ride((FIRST, SECOND, *others))
    faults = {
        "first": between(FROM_S, 30.0, lambda t, z, _: z + 0.02 * (t - FROM_S)),
        "receiver": between(22.0, 26.0, bias(-300.0)),
        "other": between(22.0, 26.0, bias(500.0)),
    }
    moments = list(train.moments(50.0, faults))
    assert at(moments, 21.9).bank.doubted == ("first", "second")
    resets = [m.bank.reset for m in moments if m.bank.reset is not None]
    again = next(reset for reset in resets if reset.reason == "no hypothesis was left: the bank starts again")
    assert abs(again.size_m) > 0.0
    assert all(m.holds() for m in moments)
    assert moments[-1].excluded == NOBODY
    assert moments[-1].bank.doubted == ()
