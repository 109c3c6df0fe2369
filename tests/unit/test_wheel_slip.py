"""Spin and slide: seen against the fused speed, not counted, and over when the wheel has run as expected for a while."""

from __future__ import annotations

import numpy as np
import pytest

from examples import head, sensor, straight_line
from milepost.sensors.base import Observer
from milepost.sensors.observed import Belief, Observed
from milepost_schemas import SpeedReading

T0_NS = 1_700_000_000 * 10**9


def watch(**slip: float) -> Observer:
    observer: Observer = sensor("odometer", straight_line(), diameter_m=0.81, slip=slip).observer()
    return observer


def belief(t_s: float = 0.0, v: float = 20.0, v_std: float = 0.05, k_std: float = 1e-4) -> Belief:
    """A train at 20 m/s with a scale of 5 %: the wheel turns as for 19.0476 m/s."""
    return Belief(np.array([20.0 * t_s, v, 0.0, 0.05]), np.diag([0.01, v_std**2, 0.01, k_std**2]))


def see(observer: Observer, t_s: float, ratio: float = 0.0, against: Belief | None = None) -> list[Observed]:
    """A reading at a time of a wheel that runs at 1 + ratio times the train's 20 m/s, with a noise of 0.05 m/s."""
    fields = {"speed_mps": 20.0 * (1.0 + ratio) / 1.05, "speed_variance_m2ps2": 0.0025, "interval_s": 0.1}
    reading = SpeedReading(**head("odo", measured_at_ns=T0_NS + round(t_s * 1e9)), **fields)
    return list(observer.observe(reading, against or belief(t_s)))


def codes(observer: Observer) -> list[str]:
    return [notice.code for notice in observer.notices() if notice.code != "wheel_diameter"]


def test_a_wheel_that_grips_counts_as_the_sensor_says() -> None:
    observer = watch()
    assert see(observer, 1.0)[0].variance == pytest.approx(1.05**2 * 0.0025, rel=0.01)
    assert codes(observer) == []
    assert not observer.gating


@pytest.mark.parametrize(("ratio", "code"), [(0.1, "wheel_spin"), (-0.1, "wheel_slide"), (-1.0, "wheel_slide")])
def test_a_slip_is_reported_once_and_its_readings_do_not_count(ratio: float, code: str) -> None:
    observer = watch()
    assert see(observer, 1.0)
    assert [see(observer, 1.1 + 0.1 * i, ratio) for i in range(5)] == [[]] * 5
    notices = observer.notices()
    assert [notice.code for notice in notices] == [code]
    assert f"slip ratio {-ratio:+.3f} at 72.0 km/h" in notices[0].text
    assert observer.gating == observer.refused == {"wheel_spin": "spinning", "wheel_slide": "sliding"}[code]


def test_a_detector_continues_from_a_given_memory() -> None:
    observer = watch()
    see(observer, 1.0)
    gripping = observer.memory
    see(observer, 1.1, 0.1)
    slipping = observer.memory
    observer.memory = gripping
    assert observer.gating is None
    assert see(observer, 1.1)
    observer.memory = slipping
    assert see(observer, 1.2) == []


def test_a_contradiction_below_the_slip_threshold_does_not_count() -> None:
    """1.9 % of 20 m/s is 0.38 m/s: 5.3 times √(0.05² + 0.0525²) = 0.0725, but no spin of 2 %."""
    observer = watch()
    assert see(observer, 1.0, 0.019) == []
    assert codes(observer) == ["wheel_off"]
    assert observer.gating == observer.refused == "contradicts the fused speed"


def test_an_uncertain_fused_speed_decides_no_slip() -> None:
    """5 % of 20 m/s is 1 m/s: 3.3 standard deviations of a speed known to 0.3 m/s."""
    observer = watch()
    vague = belief(1.0, v_std=0.3)
    assert see(observer, 1.0, 0.05, vague)
    assert codes(observer) == []


def test_an_unknown_scale_decides_nothing() -> None:
    """A nominal diameter 5 % wrong, before the scale is known to better than 6 %, is no spin."""
    observer = watch()
    assert see(observer, 1.0, 0.05, belief(1.0, k_std=0.06))
    assert codes(observer) == []


def test_a_reading_in_doubt_counts_for_less() -> None:
    """0.24 m/s is 3.3 times 0.0725: R grows until it is 2.5, (0.24/2.5)² - 0.05²."""
    seen = see(watch(), 1.0, 0.012)
    assert seen[0].variance == pytest.approx((0.24 / 2.5) ** 2 - 0.0025, rel=0.01)


def test_a_wheel_grips_again_after_the_hold_time() -> None:
    """Spin from 1.0 to 1.4 s, then as expected: 1.5, 1.6, 1.7 s are within the hold time, 1.8 s is its end."""
    observer = watch(hold_s=0.3)
    for i in range(5):
        see(observer, 1.0 + 0.1 * i, 0.1)
    assert codes(observer) == ["wheel_spin"]
    assert [bool(see(observer, t)) for t in (1.5, 1.6, 1.7)] == [False] * 3
    assert codes(observer) == []
    assert see(observer, 1.8 + 1e-6)
    (notice,) = observer.notices()
    assert notice.code == "wheel_grips"
    # five readings of 2 m/s too fast over 0.1 s each
    assert "+1.00 m further" in notice.text
    assert not observer.gating


def test_another_slip_restarts_the_hold_time() -> None:
    observer = watch(hold_s=0.3)
    see(observer, 1.0, 0.1)
    assert [bool(see(observer, 1.0 + 0.1 * i, 0.1 if i == 3 else 0.0)) for i in range(1, 7)] == [False] * 6
    assert codes(observer) == ["wheel_spin"]
    assert see(observer, 1.71)


def test_a_spin_that_becomes_a_slide_is_reported_again() -> None:
    observer = watch()
    see(observer, 1.0, 0.1)
    see(observer, 1.1, -0.1)
    assert codes(observer) == ["wheel_spin", "wheel_slide"]


def test_an_endless_slip_is_reported_as_a_wrong_diameter() -> None:
    observer = watch(longest_s=5.0)
    for i in range(100):
        see(observer, 1.0 + 0.1 * i, 0.1)
    assert codes(observer) == ["wheel_spin", "wheel_doubtful"]


def test_silence_at_speed_is_a_locked_wheel() -> None:
    observer = watch()
    reading = SpeedReading(**head("odo", measured_at_ns=T0_NS), speed_max_mps=0.27, interval_s=0.1)
    assert list(observer.observe(reading, belief())) == []
    assert codes(observer) == ["wheel_slide"]


def test_silence_at_standstill_is_no_slip() -> None:
    observer = watch()
    reading = SpeedReading(**head("odo", measured_at_ns=T0_NS), speed_max_mps=0.27, interval_s=0.1)
    assert observer.observe(reading, belief(v=0.05))
    assert codes(observer) == []


def test_a_train_that_runs_backwards_slips_by_the_same_ratio() -> None:
    observer = watch()
    fields = {"speed_mps": -20.0 * 1.1 / 1.05, "speed_variance_m2ps2": 0.0025, "interval_s": 0.1}
    reading = SpeedReading(**head("odo", measured_at_ns=T0_NS), **fields)
    assert list(observer.observe(reading, belief(v=-20.0))) == []
    assert codes(observer) == ["wheel_spin"]


def test_without_a_belief_every_reading_counts() -> None:
    observer = watch()
    reading = SpeedReading(**head("odo"), speed_mps=19.0, speed_variance_m2ps2=0.01, interval_s=0.1)
    assert observer.observe(reading, None)


def test_the_diameter_is_reported_each_hundred_metres() -> None:
    """Told 810 mm and a scale of 0.05: 850.5 mm; a scale known to 1e-3 is 0.81 mm. 5.5 s from 0 to 110 m."""
    observer = watch()
    for i in range(60):
        see(observer, 0.2 * i, against=belief(0.2 * i, k_std=1e-3))
    notices = [notice for notice in observer.notices() if notice.code == "wheel_diameter"]
    assert len(notices) == 2
    assert notices[0].text == "850.50 mm ± 0.81 at 100.0 m (nominal 810.0 mm)"


def test_a_train_that_stands_on_a_hundred_metre_mark_reports_once() -> None:
    observer = watch()
    for i in range(20):
        see(observer, 0.1 * i, against=belief(4.99 + 0.02 * (i % 2)))
    for t_s in (9.9, 10.1):
        see(observer, t_s)
    assert [notice.code for notice in observer.notices()] == ["wheel_diameter"] * 2
