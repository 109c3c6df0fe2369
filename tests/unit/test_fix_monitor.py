"""Which fixes count: proof after coasting, motions that no train can make, receivers that freeze, fixes beside the track."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyproj
import pytest

from milepost.sensors.gnss.fix_monitor import FixLimits, FixMonitor
from milepost.sensors.gnss.fix_motion import SeenFix
from milepost.track.track import Track

KNOWN = {"rtk_fixed": 0.1, "differential": 0.7, "single": 3.0}


def judged(*fixes: SeenFix, **limits: Any) -> list[str | None]:
    monitor = FixMonitor(FixLimits(**limits), KNOWN)
    return [monitor.judge(f).refused for f in fixes]


def run(
    from_s: float, to_s: float, solution: str = "rtk_fixed", off_m: float = 0.0, cross_m: float = 1.0, **more: Any
) -> list[SeenFix]:
    """Fixes every half second of a train at 20 m/s."""
    count = round((to_s - from_s) / 0.5)
    times = [from_s + 0.5 * k for k in range(count)]
    return [SeenFix(t, solution, 20.0 * t + off_m, cross_m, KNOWN.get(solution, 0.1), **more) for t in times]


def test_sound_fixes_count_from_the_first() -> None:
    assert set(judged(*run(0.0, 10.0))) == {None}


def test_short_coasting_costs_nothing_and_long_coasting_the_trust() -> None:
    short = judged(*run(0.0, 5.0), *run(5.0, 9.5, "propagated"), *run(9.5, 12.0))
    assert short == [None] * 10 + ["solution"] * 9 + [None] * 5
    long = judged(*run(0.0, 5.0), *run(5.0, 11.0, "propagated"), *run(11.0, 20.0))
    # sound for 6 s at a stretch: from 11.0 to 17.0
    assert long == [None] * 10 + ["solution"] * 12 + ["unproven"] * 12 + [None] * 6


def test_bursts_of_what_calls_itself_rtk_prove_nothing_however_many() -> None:
    bursts = [f for k in range(20) for f in (*run(20.0 + 6 * k, 22.0 + 6 * k, "propagated"), *run(22.0 + 6 * k, 26.0 + 6 * k))]
    assert None not in judged(*run(10.0, 20.0, "propagated"), *bursts)


def test_short_coasting_adds_up_unless_rtk_makes_up_for_it() -> None:
    paid = [f for k in range(10) for f in (*run(8.0 * k, 8.0 * k + 4.0), *run(8.0 * k + 4.0, 8.0 * k + 8.0, "propagated"))]
    assert judged(*paid).count(None) == 80
    unpaid = [f for k in range(10) for f in (*run(6.0 * k, 6.0 * k + 2.0), *run(6.0 * k + 2.0, 6.0 * k + 6.0, "propagated"))]
    assert judged(*unpaid).count(None) == 8


def test_a_fix_that_comes_late_or_twice_proves_nothing() -> None:
    coasted = run(0.0, 6.0, "propagated")
    proving = run(6.0, 9.0)
    assert judged(*coasted, *proving, proving[-1], proving[2])[-2:] == ["unproven", "unproven"]
    # and where it is late among those that are no fixes, it does not begin a proof in the past
    assert judged(*coasted, SeenFix(3.1, "rtk_fixed", 62.0, 1.0, 0.1)) == ["solution"] * 12 + ["unproven"]


def test_a_late_report_of_coasting_does_not_interrupt_a_proof() -> None:
    proof = judged(*run(0.0, 6.0, "propagated"), *run(6.0, 9.0), *run(5.0, 5.5, "propagated"), *run(9.0, 13.0))
    assert proof == ["solution"] * 12 + ["unproven"] * 6 + ["solution"] + ["unproven"] * 6 + [None] * 2


def test_silence_is_not_coasting_but_interrupts_a_proof() -> None:
    assert judged(*run(0.0, 2.0), *run(60.0, 62.0)) == [None] * 8
    proof = judged(*run(0.0, 6.0, "propagated"), *run(6.0, 10.0), *run(13.0, 20.0))
    assert proof == ["solution"] * 12 + ["unproven"] * 20 + [None] * 2


def test_an_impossible_jump_costs_the_trust_until_proved_again() -> None:
    told = judged(*run(0.0, 5.0), *run(5.0, 15.0, off_m=50.0))
    assert told[:10] == [None] * 10
    # 50 m in half a second; the speeds on both sides of it differ too
    assert told[10] == "jump"
    assert "unproven" in told[11:24]
    assert told[-4:] == [None] * 4
    # where the receiver gives its speed, the jump shows at once and only once
    sure = judged(*run(0.0, 5.0, speed_mps=20.0), *run(5.0, 15.0, off_m=50.0, speed_mps=20.0))
    assert sure == [None] * 10 + ["jump"] + ["unproven"] * 12 + [None] * 7


def test_braking_as_hard_as_trains_can_is_no_jump() -> None:
    fixes = [SeenFix(t, "rtk_fixed", 30.0 * t - 1.25 * t * t, 1.0, 0.01) for t in (0.4 * k for k in range(30))]
    assert set(judged(*fixes)) == {None}


def test_stand_alone_fixes_are_not_asked_to_prove_anything() -> None:
    assert judged(*run(0.0, 10.0, "propagated"), *run(10.0, 12.0, "single")) == ["solution"] * 20 + [None] * 4


@pytest.mark.parametrize(
    ("satellites", "refused", "factor"), [(3, "satellites", 1.0), (4, None, 2.0), (10, None, 2.0), (11, None, 1.0)]
)
def test_satellites_decide_on_stand_alone_fixes_as_in_source_c(satellites: int, refused: str | None, factor: float) -> None:
    (one,) = run(0.0, 0.5, "single", satellites=satellites)
    assert FixMonitor(FixLimits(), KNOWN).judge(one) == (refused, factor)
    (rtk,) = run(0.0, 0.5, satellites=satellites)
    assert FixMonitor(FixLimits(), KNOWN).judge(rtk) == (refused, 1.0)


@pytest.mark.parametrize(
    ("cross", "std", "refused"),
    [
        (9.9, 0.1, None),
        (-9.9, 0.1, None),
        (10.1, 0.1, "off_track"),
        (-10.1, 0.1, "off_track"),
        (39.0, 10.0, None),
        (41.0, 10.0, "off_track"),
        (math.nan, 0.1, "off_track"),
        (math.inf, 0.1, "off_track"),
    ],
)
def test_distance_from_the_track_has_a_limit_or_standard_deviations(cross: float, std: float, refused: str | None) -> None:
    assert judged(SeenFix(0.0, "rtk_fixed", 0.0, cross, std)) == [refused]


@pytest.mark.parametrize(
    ("turned", "refused"), [(0.0, None), (19.0, None), (-161.0, None), (21.0, "off_course"), (90.0, "off_course")]
)
def test_a_course_across_the_track_is_not_this_trains(turned: float, refused: str | None) -> None:
    assert judged(SeenFix(0.0, "rtk_fixed", 0.0, 1.0, 0.1, None, 20.0, turned)) == [refused]


# motions ------------------------------------------------------------------------------------------------------------------


def stepped(speeds: list[float], solution: str = "rtk_fixed", step_s: float = 0.4) -> list[SeenFix]:
    """Fixes between which a train runs at the speeds given, one step each."""
    places = np.concatenate([[100.0], 100.0 + step_s * np.cumsum(speeds)])
    return [SeenFix(step_s * k, solution, float(s), 1.0, KNOWN[solution]) for k, s in enumerate(places)]


@pytest.mark.parametrize(("change", "refused"), [(4.2, None), (-4.2, None), (4.3, "jump"), (-4.3, "jump"), (28.0, "jump")])
def test_a_change_of_speed_is_bounded_by_acceleration_and_noise(change: float, refused: str | None) -> None:
    """3 m/s² × 0.4 s + 5 × 0.1 m × √(1 + 4 + 1) / 0.4 s = 4.26 m/s."""
    assert judged(*stepped([20.0] * 5 + [20.0 + change]))[-1] == refused


def test_false_rtk_that_slows_from_19_to_11_is_refused() -> None:
    """As it was recorded: 19.3 and 10.8 m/s in neighbouring steps of 0.4 s, near the track, without coasting before."""
    told = judged(*stepped([19.3] * 20 + [10.8] * 10))
    assert told == [None] * 21 + ["jump"] + ["unproven"] * 9


@pytest.mark.parametrize(("acceleration", "refused"), [(2.9, False), (8.0, True), (-8.0, True)])
def test_a_change_that_no_step_shows_is_seen_over_seconds(acceleration: float, refused: bool) -> None:
    """8 m/s² change a step's speed by 3.2 m/s, but over 1.2 s by 9.6, and 3 × 1.2 + 5 × 0.1 × √6 / 1.2 = 4.6 are allowed."""
    speeds = [30.0] * 20 + [30.0 + 0.4 * acceleration * k for k in range(1, 8)]
    assert ("jump" in judged(*stepped(speeds))) is refused


def test_a_kink_of_the_map_is_no_jump() -> None:
    """4 m beside a track that turns by 30°, nearest points advance by 4 m × 2 tan 15° = 2.1 m more or less."""
    geod = pyproj.Geod(ellps="WGS84")
    corner = geod.fwd(4.5, 50.9, 90.0, 200.0)[:2]
    track = Track([(4.5, 50.9), corner, geod.fwd(*corner, 120.0, 200.0)[:2]])
    for side, pulled_m in ((1.0, -2.14), (-1.0, 2.14)):
        # on a parallel track 4 m beside, which has its own corner where the angle's bisector meets it
        places = [s + (pulled_m if s > 200.0 else 0.0) for s in np.arange(100.0, 300.0, 8.0)]
        fixes = [SeenFix(0.4 * k, "rtk_fixed", float(s), 4.0 * side, 0.1) for k, s in enumerate(places)]
        monitor = FixMonitor(FixLimits(), KNOWN, track.length_m, track.turning)
        assert {monitor.judge(f).refused for f in fixes} == {None}
        assert "jump" in judged(*fixes)


@pytest.mark.parametrize(
    ("aside", "refused"), [(1.6, None), (-1.6, None), (1.7, "cross_track_jump"), (-1.7, "cross_track_jump")]
)
def test_a_step_across_the_track_is_bounded(aside: float, refused: str | None) -> None:
    """0.12 × 8 m + 5 × 0.1 m × √2 = 1.67 m, whatever the speed along the track does."""
    *before, last = stepped([20.0] * 6)
    assert judged(*before, last._replace(cross_track_m=1.0 + aside))[-1] == refused


@pytest.mark.parametrize(("gap_s", "refused"), [(8.0, "cross_track_jump"), (9.0, None)])
def test_motions_are_not_compared_after_a_long_gap(gap_s: float, refused: str | None) -> None:
    """4 m aside at the same chainage: a train may have gone over a switch and back meanwhile."""
    standing = [SeenFix(0.5 * k, "rtk_fixed", 100.0, 1.0, 0.1) for k in range(10)]
    assert judged(*standing, SeenFix(4.5 + gap_s, "rtk_fixed", 100.0, -3.0, 0.1)) == [None] * 10 + [refused]


@pytest.mark.parametrize("solution", ["differential", "single"])
def test_a_fix_that_contradicts_the_others_is_refused_alone(solution: str) -> None:
    fixes = run(0.0, 20.0, solution)
    fixes[20] = fixes[20]._replace(position_m=fixes[20].position_m + 120.0)
    assert judged(*fixes) == [None] * 20 + ["jump"] + [None] * 19


@pytest.mark.parametrize("solution", ["differential", "single"])
def test_fixes_elsewhere_count_once_they_have_lasted(solution: str) -> None:
    told = judged(*run(0.0, 20.0, solution), *run(20.0, 40.0, solution, off_m=150.0))
    assert told[:40] == [None] * 40
    assert told[40:52] == ["jump"] * 12
    assert told[52:] == [None] * 28


def test_a_wrong_first_fix_does_not_hold_off_the_others() -> None:
    first, *others = run(0.0, 10.0, "single")
    told = judged(first._replace(position_m=300.0), *others)
    assert told.count("jump") <= 3
    assert told[-14:] == [None] * 14


def test_rtk_is_not_doubted_on_a_poorer_solutions_word() -> None:
    told = judged(*run(0.0, 5.0), *run(5.0, 10.0, "single", off_m=60.0), *run(10.0, 15.0))
    assert told[:10] == told[20:] == [None] * 10


def test_fixes_that_deny_the_receivers_own_speed_are_refused() -> None:
    """Fixes at 15 m/s, own speed 20: 2 m off in a step. Allowed: 5 × 0.1 √2 + 5 × 0.25 × 0.4 + 3 × 0.4²/4 = 1.3 m."""
    fixes = [SeenFix(0.4 * k, "rtk_fixed", 15.0 * 0.4 * k, 1.0, 0.1, None, 20.0) for k in range(10)]
    assert judged(*fixes)[:2] == [None, "jump"]
    # and one that changes by 6 m/s in 0.4 s: 1.2 + 5 × 0.25 √2 = 3.0 m/s are
    steady = [f._replace(position_m=20.0 * f.t_s) for f in fixes]
    assert judged(*steady[:5], steady[5]._replace(speed_mps=26.0)) == [None] * 5 + ["jump"]


# receivers that stand still -----------------------------------------------------------------------------------------------


def stopped(solution: str, speed: float, dither_m: float = 0.0, frozen: int = 150) -> list[SeenFix]:
    """Fixes at 2.5 Hz of a receiver whose output stands still after 10 s at a speed."""
    moving = stepped([speed] * 25, solution)
    noise = np.random.default_rng(3).uniform(-dither_m, dither_m, (frozen, 2))
    last = moving[-1]
    return moving + [
        last._replace(t_s=last.t_s + 0.4 * (k + 1), position_m=last.position_m + a, cross_track_m=last.cross_track_m + b)
        for k, (a, b) in enumerate(noise.tolist())
    ]


@pytest.mark.parametrize("solution", ["rtk_fixed", "differential", "single"])
def test_a_receiver_frozen_at_speed_is_refused_at_once(solution: str) -> None:
    assert judged(*stopped(solution, 20.0)) == [None] * 26 + ["frozen"] * 150


@pytest.mark.parametrize("solution", ["rtk_fixed", "differential"])
def test_a_frozen_receiver_that_dithers_by_centimetres_is_refused(solution: str) -> None:
    """Three fixes within 10 cm: the first of them is the last true one."""
    told = judged(*stopped(solution, 20.0, 0.03))
    assert told[:26] == [None] * 26
    assert told[27:] == ["frozen"] * 149


def test_rtk_that_was_frozen_has_to_prove_itself() -> None:
    frozen = stopped("rtk_fixed", 20.0, frozen=50)
    later = [SeenFix(30.4 + 0.4 * k, "rtk_fixed", 708.0 + 8.0 * k, 1.0, 0.1) for k in range(20)]
    assert judged(*frozen, *later)[76:] == ["unproven"] * 15 + [None] * 5


def test_a_frozen_stand_alone_receiver_counts_again_when_it_moves() -> None:
    frozen = stopped("single", 20.0, frozen=50)
    later = [SeenFix(30.4 + 0.4 * k, "single", 708.0 + 8.0 * k, 1.0, 3.0) for k in range(20)]
    assert judged(*frozen, *later)[76:] == [None] * 20


def test_a_receivers_own_speed_gives_a_frozen_position_away() -> None:
    """Where its positions are too coarse to show it: 5 m/s with σ = 3 m."""
    still = [SeenFix(0.4 * k, "single", 100.0 + 2.0 * min(k, 10), 1.0, 3.0, None, 5.0) for k in range(20)]
    assert judged(*still) == [None] * 11 + ["frozen"] * 9


@pytest.mark.parametrize("solution", ["rtk_fixed", "differential", "single"])
@pytest.mark.parametrize("hold_mps", [0.0, 0.5])
def test_a_train_that_brakes_to_a_stop_is_not_frozen(solution: str, hold_mps: float) -> None:
    """2.5 m/s², an emergency stop; many receivers hold their position below some speed, here 0 and 0.5 m/s."""
    t = 0.4 * np.arange(100)
    held = (20.0 - hold_mps) / 2.5
    braked = np.minimum(t, held)
    places = 100.0 + 20.0 * braked - 1.25 * braked**2
    fixes = [SeenFix(a, solution, b, 1.0, KNOWN[solution]) for a, b in zip(t.tolist(), places.tolist(), strict=True)]
    assert set(judged(*fixes)) == {None}


# beside the track ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("aside_m", "refused"), [(4.9, None), (-4.9, None), (5.1, "off_track_mean"), (-8.0, "off_track_mean")])
def test_rtk_beside_the_track_is_refused_from_the_third(aside_m: float, refused: str | None) -> None:
    assert judged(*run(0.0, 20.0, cross_m=aside_m)) == [None] * 2 + [refused] * 38


def test_a_long_run_of_rtk_beside_the_track_proves_nothing() -> None:
    """As it was recorded: after coasting, 7.6 s of smooth RTK that lies 8.6 to 6.4 m beside the track."""
    beside = [f._replace(cross_track_m=8.6 - 0.29 * (f.t_s - 10.0)) for f in run(10.0, 18.0)]
    told = judged(*run(0.0, 10.0, "propagated"), *beside, *run(18.0, 30.0))
    assert None not in told[20:36]
    assert told[-10:] == [None] * 10


@pytest.mark.parametrize(("aside_m", "refused"), [(11.9, None), (12.1, "off_track_mean")])
def test_the_mean_of_poorer_fixes_has_their_standard_deviation(aside_m: float, refused: str | None) -> None:
    """4 × 3 m; slow errors are common to all of the mean, so it is no better than one of them."""
    fixes = [f._replace(cross_track_m=aside_m) for f in run(0.0, 5.0, "single")]
    assert judged(*fixes, cross_track_m=20.0)[-1] == refused


@pytest.mark.parametrize(
    ("place_m", "refused"), [(-0.3, None), (-0.5, "off_line"), (-30.0, "off_line"), (1000.3, None), (1000.5, "off_line")]
)
def test_fixes_outside_the_line_count_within_their_noise(place_m: float, refused: str | None) -> None:
    monitor = FixMonitor(FixLimits(), KNOWN, 1000.0)
    assert monitor.judge(SeenFix(0.0, "rtk_fixed", place_m, 1.0, 0.1)).refused == refused


# what is remembered -------------------------------------------------------------------------------------------------------


def eventful() -> list[SeenFix]:
    """Coasting, a proof, a jump, poorer solutions, a frozen receiver, fixes beside the track."""
    return [
        *run(0.0, 6.0, "propagated"),
        *run(6.0, 15.0),
        *run(15.0, 25.0, off_m=30.0),
        *run(25.0, 30.0, "single"),
        *run(30.0, 35.0, "single", off_m=120.0),
        *[f._replace(position_m=800.0) for f in run(35.0, 40.0)],
        *run(40.0, 55.0, cross_m=7.0),
        *run(55.0, 70.0, "differential"),
    ]


def test_judging_continues_from_whatever_memory_is_set() -> None:
    """From every fix on, the same verdicts as the first time; and no memory was changed meanwhile."""
    fixes = eventful()
    monitor = FixMonitor(FixLimits(), KNOWN)
    memories, verdicts = [], []
    for f in fixes:
        memories.append(monitor.memory)
        verdicts.append(monitor.judge(f))
    assert len({v.refused for v in verdicts}) >= 6
    seen = [repr(memory) for memory in memories]
    for k in range(len(fixes) - 1, -1, -7):
        monitor.memory = memories[k]
        assert [monitor.judge(f) for f in fixes[k:]] == verdicts[k:]
    assert [repr(memory) for memory in memories] == seen
    assert all(hash(memory) is not None for memory in memories)


# sound trains -------------------------------------------------------------------------------------------------------------


def driven(seed: int, seconds: float, step_s: float) -> list[tuple[float, float, float]]:
    """Time, position and speed of a train whose acceleration changes at random within ±2.9 m/s², between 0 and 40 m/s."""
    rng = np.random.default_rng(seed)
    s, v, a, until, out = 100.0, 20.0, 0.0, 0.0, []
    for k in range(round(seconds / step_s)):
        t = step_s * k
        if t >= until:
            a, until = rng.uniform(-2.9, 2.9), t + rng.uniform(1.0, 20.0)
        if not 0.0 <= v + a * step_s <= 40.0:
            a = 0.0
        out.append((t, s, v))
        s, v = s + v * step_s + 0.5 * a * step_s**2, v + a * step_s
    return out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("solution", "std", "step_s", "own"),
    [
        ("rtk_fixed", 0.1, 0.4, False),
        ("rtk_fixed", 0.02, 0.1, True),
        ("differential", 0.7, 0.2, True),
        ("single", 3.0, 0.2, False),
    ],
)
def test_a_train_within_its_limits_is_hardly_ever_refused(solution: str, std: float, step_s: float, own: bool) -> None:
    """20 seeds of two minutes, noise of the standard deviation stated: at most one fix in 10 000 refused, proofs included."""
    refused, fixes = 0, 0
    for seed in range(20):
        rng = np.random.default_rng(1000 + seed)
        monitor = FixMonitor(FixLimits(), {solution: std})
        for t, s, v in driven(seed, 120.0, step_s):
            along, across, speed = rng.standard_normal(3).tolist()
            f = SeenFix(1.7e9 + t, solution, s + std * along, std * across, std, None, v + 0.2 * speed if own else None)
            refused += monitor.judge(f).refused is not None
            fixes += 1
    assert fixes >= 6000
    assert refused <= 1e-4 * fixes
