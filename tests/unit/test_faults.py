"""What each kind of fault makes of each kind of reading, worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import pytest
from pydantic import ValidationError

from examples import T0, head, surveyed_line, world
from milepost.simulation.faults import FaultEntry, Injection, Sent, Surroundings
from milepost.simulation.noise import standard_normal
from milepost_schemas import BaliseTelegram, InertialReading, Message, PositionReading, SpeedReading

S = 1_000_000_000
LINE = surveyed_line()
SENSORS = {
    "speed_reading": "odometer",
    "position_reading": "gnss",
    "inertial_reading": "imu",
    "balise_telegram": "balise_reader",
}
TRACK = LINE.track
assert TRACK is not None


def speed(t_s: float, value: float | None = 20.0, **changed: Any) -> SpeedReading:
    said = {"speed_mps": value, "speed_variance_m2ps2": 0.04} if value is not None else {"speed_max_mps": 0.5}
    return SpeedReading(**stamped(t_s), **{**said, **changed})


def position(at_m: float, t_s: float = 1.0, **changed: Any) -> PositionReading:
    latitude, longitude = TRACK.locate(at_m)
    said: dict[str, Any] = {"solution": "differential", "horizontal_std_m": 0.5, "speed_mps": 20.0, "course_deg": 0.0}
    return PositionReading(**stamped(t_s), latitude_deg=latitude, longitude_deg=longitude, **{**said, **changed})


def inertial(t_s: float = 1.0) -> InertialReading:
    return InertialReading(
        **stamped(t_s), specific_force_mps2=[0.5, 0.25, -9.75], turn_rate_radps=[0.0, 0.0, 0.125], mean_over_s=0.04
    )


def telegram(balise_id: str, t_s: float = 1.0) -> BaliseTelegram:
    return BaliseTelegram(**stamped(t_s), balise_id=balise_id, reader_variance_m2=4e-4)


def stamped(t_s: float) -> dict[str, Any]:
    at = T0 + round(t_s * S)
    return head(measured_at_ns=at, published_at_ns=at + 1_000_000, sequence=round(t_s * 1000))


def around(stream: str) -> Surroundings:
    motion = world().motion
    return Surroundings("u1", stream, SENSORS[stream], LINE, motion, 7, {"single": 3.0}, 0.1)


def passed(
    readings: Iterable[Message], kind: str, from_s: float = 1.0, for_s: float | None = None, **options: Any
) -> list[Any]:
    """What a fault makes of readings; the stream is that of the first."""
    readings = list(readings)
    entry = FaultEntry.model_validate({"unit": "u1", "kind": kind, "from_s": from_s, "for_s": for_s, **options})
    injection = Injection(around(readings[0].SCHEMA), T0, [entry])
    return [injection.send(reading) for reading in readings]


def one(reading: Message, kind: str, **options: Any) -> Any:
    """The one message that a fault makes of a reading at once."""
    ((sent,),) = passed([reading], kind, **options)
    assert sent.delay_s == 0.0
    return sent.message


def said(sent: Iterable[list[Sent]]) -> list[Any]:
    return [out.message for outs in sent for out in outs]


def place(reading: Any) -> tuple[float, float]:
    """Metres along the surveyed line and to the right of it."""
    found = TRACK.project(reading.latitude_deg, reading.longitude_deg)
    return found.position_m, found.cross_track_m


def only(reading: Message, **changed: Any) -> Message:
    return reading.model_copy(update=changed)


# reading, fault, options, the fields that are then different
CASES: list[tuple[Message, str, dict[str, Any], dict[str, Any]]] = [
    (speed(1.0), "bias", {"size": -0.5}, {"speed_mps": 19.5}),
    (speed(1.0, None), "bias", {"size": 0.25}, {"speed_max_mps": 0.75}),
    (speed(1.0, None), "bias", {"size": -2.0}, {"speed_max_mps": 1e-3}),
    (inertial(), "bias", {"size": 0.25}, {"specific_force_mps2": [0.75, 0.25, -9.75]}),
    (speed(3.0), "ramp", {"rate": 0.125}, {"speed_mps": 20.25}),
    (inertial(3.0), "ramp", {"rate": 0.5}, {"specific_force_mps2": [1.5, 0.25, -9.75]}),
    (speed(1.0), "scale", {"factor": 1.25}, {"speed_mps": 25.0}),
    (speed(1.0, None), "scale", {"factor": 0.5}, {"speed_max_mps": 0.25}),
    (inertial(), "scale", {"factor": 3.0}, {"specific_force_mps2": [1.5, 0.25, -9.75]}),
    (speed(1.0), "intermittent", {"size": 2.0}, {"speed_mps": 22.0}),
    (speed(1.9), "intermittent", {"size": 2.0, "period_s": 1.0}, {}),
    (speed(2.3), "intermittent", {"size": 2.0, "period_s": 1.0, "duty": 0.4}, {"speed_mps": 22.0}),
    (speed(2.5), "intermittent", {"size": 2.0, "period_s": 1.0, "duty": 0.4}, {}),
    (speed(1.25), "spin", {"ratio": 0.5}, {"speed_mps": 25.0}),
    (speed(5.0), "spin", {"ratio": 0.5}, {"speed_mps": 30.0}),
    (speed(9.75), "slide", {"ratio": -0.5, "for_s": 9.0}, {"speed_mps": 15.0}),
    (speed(5.0), "slide", {"ratio": -1.0, "for_s": 9.0}, {"speed_mps": 0.0}),
    (
        speed(1.0),
        "clock_step",
        {"by_s": -0.5},
        {"measured_at_ns": T0 + 500_000_000, "published_at_ns": T0 + 501_000_000},
    ),
    # three seconds after the onset at a second, 500 µs each
    (speed(4.0), "clock_drift", {"ppm": 500.0}, {"measured_at_ns": T0 + 4_001_500_000, "published_at_ns": T0 + 4_002_500_000}),
    (telegram("b00003"), "wrong_balise", {}, {"balise_id": "b00004"}),
    (telegram("b00003"), "wrong_balise", {"says": "b00017"}, {"balise_id": "b00017"}),
    (telegram("b00003"), "wrong_balise", {"balise": "b00005"}, {}),
    (telegram(LINE.balises[-1].balise_id), "wrong_balise", {}, {"balise_id": LINE.balises[-2].balise_id}),
]


@pytest.mark.parametrize(
    ("reading", "kind", "options", "changed"), CASES, ids=lambda case: case if isinstance(case, str) else ""
)
def test_a_fault_changes_what_it_says_and_nothing_else(
    reading: Message, kind: str, options: dict[str, Any], changed: dict[str, Any]
) -> None:
    assert one(reading, kind, **options) == only(reading, **changed)


@pytest.mark.parametrize(
    ("kind", "options", "along_m", "right_m"),
    [
        ("bias", {"size": 3.0}, 3.0, 0.0),
        ("ramp", {"rate": -1.5}, -3.0, 0.0),
        ("jump", {"size": 50.0}, 50.0, 0.0),
        ("intermittent", {"size": 10.0, "period_s": 8.0}, 10.0, 0.0),
        ("drag", {"rate_mps": 2.0}, 4.0, 0.0),
        ("false_rtk", {"along_m": 4.0, "beside_m": -7.0}, 4.0, -7.0),
    ],
)
def test_a_position_is_moved_along_and_beside_the_track(
    kind: str, options: dict[str, Any], along_m: float, right_m: float
) -> None:
    honest = position(3000.0, 3.0)
    lie = one(honest, kind, **options)
    s, right = place(lie)
    assert s == pytest.approx(3000.0 + along_m, abs=1e-4)
    assert right == pytest.approx(right_m, abs=1e-3)
    changed = {"latitude_deg": lie.latitude_deg, "longitude_deg": lie.longitude_deg}
    if kind == "false_rtk":
        changed |= {"solution": "rtk_fixed", "horizontal_std_m": 0.02}
    assert lie == only(honest, **changed)


def test_a_position_keeps_its_own_error_when_it_is_moved() -> None:
    honest = position(3000.0)
    beside = only(honest, longitude_deg=honest.longitude_deg + 2e-5)
    _, right_m = place(beside)
    assert right_m > 1.0
    assert place(one(beside, "jump", size=50.0)) == pytest.approx((3050.0, right_m), abs=1e-3)


def test_beyond_the_end_of_the_line_the_track_goes_on_straight() -> None:
    assert place(one(position(TRACK.length_m - 5.0), "jump", size=25.0))[0] == pytest.approx(TRACK.length_m + 20.0, abs=1e-3)
    assert place(one(position(5.0), "jump", size=-25.0))[0] == pytest.approx(-20.0, abs=1e-3)


def test_a_drag_takes_the_speed_along_where_asked() -> None:
    assert one(position(3000.0, 3.0), "drag", rate_mps=2.0, with_speed=True).speed_mps == 22.0


def test_a_stuck_unit_repeats_its_last_content_under_new_stamps() -> None:
    readings = [speed(0.8, 18.0), speed(0.9, 19.0, interval_s=0.5), speed(1.0, 20.0), speed(1.1, 21.0), speed(1.3, 22.0)]
    out = said(passed(readings, "stuck", for_s=0.2))
    assert [m.speed_mps for m in out] == [18.0, 19.0, 19.0, 19.0, 22.0]
    assert [m.interval_s for m in out] == [0.0, 0.5, 0.5, 0.5, 0.0]
    assert [m.measured_at_ns for m in out] == [m.measured_at_ns for m in readings]
    assert [m.sequence for m in out] == [m.sequence for m in readings]


def test_a_unit_stuck_from_the_beginning_repeats_its_first_content() -> None:
    assert [m.speed_mps for m in said(passed([speed(1.0, 5.0), speed(1.1, 6.0)], "stuck"))] == [5.0, 5.0]


@pytest.mark.parametrize(
    ("reading", "options", "std"),
    [
        (speed(1.0), {}, 0.2),
        (speed(1.0), {"std": 0.5}, 0.5),
        (inertial(), {}, 0.1 / math.sqrt(0.04)),
        (position(3000.0), {}, 0.5),
        (position(3000.0, solution="single", horizontal_std_m=None), {}, 3.0),
    ],
)
def test_noise_is_so_many_standard_deviations_from_the_seed(reading: Any, options: dict[str, Any], std: float) -> None:
    first, second = standard_normal(7, "u1.fault.1.0.1000", 2) * 10.0 * std
    lie = one(reading, "noise", factor=10.0, **options)
    if isinstance(reading, PositionReading):
        # due north: the first is to the right, the second along
        assert place(lie) == pytest.approx((3000.0 + second, first), abs=1e-3)
    elif isinstance(reading, InertialReading):
        assert lie.specific_force_mps2 == [0.5 + first, 0.25, -9.75]
    else:
        assert lie.speed_mps == 20.0 + first


def test_noise_differs_from_reading_to_reading_and_not_from_run_to_run() -> None:
    readings = [speed(1.0 + 0.01 * n) for n in range(2000)]
    errors = [m.speed_mps - 20.0 for m in said(passed(readings, "noise", factor=10.0))]
    assert errors == [m.speed_mps - 20.0 for m in said(passed(readings, "noise", factor=10.0))]
    # 2000 draws: the standard deviation is known to 1.6 %
    assert math.sqrt(sum(e * e for e in errors) / 2000) == pytest.approx(2.0, rel=0.06)


def test_a_bound_and_an_unknown_noise_stay_as_they_are() -> None:
    assert one(speed(1.0, None), "noise", factor=10.0) == speed(1.0, None)
    fix = position(3000.0, horizontal_std_m=None)
    assert one(fix, "noise", factor=10.0) == fix


@pytest.mark.parametrize("kind", ["drop_out", "missed_balise"])
def test_what_is_not_sent_leaves_no_gap_in_the_numbers(kind: str) -> None:
    readings = [only(telegram(f"b0000{n}", 0.5 * n), sequence=n) for n in range(1, 7)]
    out = passed(readings, kind, for_s=1.0)
    assert [len(sent) for sent in out] == [1, 0, 0, 1, 1, 1]
    assert [m.sequence for m in said(out)] == [1, 2, 3, 4]


def test_only_the_named_balise_is_missed() -> None:
    out = said(passed([telegram("b00001", 1.0), telegram("b00002", 2.0)], "missed_balise", balise="b00001"))
    assert [m.balise_id for m in out] == ["b00002"]


def test_a_delayed_reading_keeps_its_stamps() -> None:
    assert passed([speed(1.0)], "delay", by_s=0.5) == [[Sent(speed(1.0), 0.5)]]


def test_a_late_stamp_is_never_in_the_future() -> None:
    ((sent,),) = passed([speed(1.0)], "late_stamp", by_s=0.5)
    later = {"measured_at_ns": T0 + 1_500_000_000, "published_at_ns": T0 + 1_501_000_000}
    assert sent == Sent(only(speed(1.0), **later), 0.5)


def test_old_content_is_sent_as_new_under_another_instance() -> None:
    readings = [speed(t, t) for t in (0.0, 1.0, 2.0, 3.0)]
    out = said(passed(readings, "restamp", age_s=1.5))
    assert [m.speed_mps for m in out] == [0.0, 0.0, 0.0, 1.0]
    assert [m.instance for m in out] == ["a1b2c3d4", *["a1b2c3d4-again"] * 3]
    assert [m.measured_at_ns for m in out] == [m.measured_at_ns for m in readings]


def test_a_duplicate_has_its_own_instance_and_the_same_stamps() -> None:
    ((first, second, third),) = passed([speed(1.0)], "duplicate", times=2)
    assert first == Sent(speed(1.0))
    assert second == Sent(only(speed(1.0), instance="a1b2c3d4-copy1"))
    assert third == Sent(only(speed(1.0), instance="a1b2c3d4-copy2"))


def test_duplicates_may_be_stamped_each_a_little_later() -> None:
    out = said(passed([speed(1.0)], "duplicate", times=2, offset_ms=0.5))
    assert [m.measured_at_ns - T0 - S for m in out] == [0, 500_000, 1_000_000]


@pytest.mark.parametrize("kind", ["wrong_balise", "moved_balise"])
def test_one_telegram_is_wrong_unless_all_are_asked_for(kind: str) -> None:
    readings = [telegram("b00001", 5.0), telegram("b00002", 10.0)]
    options = {"offset_m": -10.0} if kind == "moved_balise" else {}
    first, second = said(passed(readings, kind, **options))
    assert first != readings[0]
    assert second == readings[1]
    first, second = said(passed(readings, kind, once=False, **options))
    assert first != readings[0]
    assert second != readings[1]


def test_a_balise_that_lies_farther_is_read_when_the_train_is_there() -> None:
    # at 20 m/s, 10 m are half a second
    ((sent,),) = passed([telegram("b00001", 5.0)], "moved_balise", offset_m=10.0)
    assert sent.delay_s == pytest.approx(0.5, abs=1e-9)
    assert sent.message.measured_at_ns == pytest.approx(T0 + 5.5 * S, abs=2)
    assert sent.message.published_at_ns == pytest.approx(T0 + 5.501 * S, abs=2)
    ((sent,),) = passed([telegram("b00001", 5.0)], "moved_balise", offset_m=-10.0)
    assert sent.delay_s == 0.0
    assert sent.message.measured_at_ns == pytest.approx(T0 + 4.5 * S, abs=2)
    assert sent.message.published_at_ns == telegram("b00001", 5.0).published_at_ns


def test_a_moved_balise_that_the_train_never_reaches_is_not_read() -> None:
    assert passed([telegram("b00001", 5.0)], "moved_balise", offset_m=1e5) == [[]]


def test_faults_of_one_unit_act_one_after_another() -> None:
    entries = [
        FaultEntry.model_validate({"unit": "u1", "kind": "scale", "from_s": 0.0, "factor": 2.0}),
        FaultEntry.model_validate({"unit": "u1", "kind": "bias", "from_s": 0.0, "size": 1.0}),
        FaultEntry.model_validate({"unit": "u1", "kind": "duplicate", "from_s": 0.0, "times": 1}),
        FaultEntry.model_validate({"unit": "u1", "kind": "delay", "from_s": 0.0, "by_s": 0.25}),
    ]
    sent = Injection(around("speed_reading"), T0, entries).send(speed(1.0))
    assert [(out.message.speed_mps, out.delay_s) for out in sent] == [(41.0, 0.25)] * 2  # type: ignore[attr-defined]


def test_what_no_message_can_say_is_not_sent() -> None:
    with pytest.raises(ValidationError, match="speed_mps"):
        passed([speed(1.0)], "scale", factor=1e6)


MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"kind": "bais", "size": 1.0}, "must be one of bias, ramp"),
    ({"kind": "bias"}, "size: required"),
    ({"kind": "bias", "size": math.nan}, "size: Input should be a finite number"),
    ({"kind": "bias", "size": "much"}, "size: Input should be a valid number"),
    ({"kind": "bias", "size": 1.0, "rate": 1.0}, "rate: not an option of bias, which has size"),
    ({"kind": "stuck", "size": 1.0}, "size: not an option of stuck, which has none"),
    ({"kind": "slide", "ratio": 0.5}, "ratio: Input should be less than 0"),
    ({"kind": "duplicate", "times": 0}, "times: Input should be greater than or equal to 1"),
    ({"kind": "stuck", "for_s": 0.0}, "for_s"),
]


@pytest.mark.parametrize(("fields", "says"), MISTAKES)
def test_a_mistake_in_a_fault_is_named(fields: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        FaultEntry.model_validate({"unit": "u1", "from_s": 0.0, **fields})


NEEDS: list[tuple[str, Callable[[], Surroundings], str]] = [
    ("jump", lambda: around("speed_reading"), "jump does not fit speed_reading, but position_reading"),
    (
        "spin",
        lambda: Surroundings("u1", "speed_reading", "doppler_radar", LINE),
        "spin does not fit doppler_radar, but odometer",
    ),
    ("moved_balise", lambda: Surroundings("u1", "balise_telegram", "balise_reader", LINE), "needs a train with a `world`"),
]


@pytest.mark.parametrize(("kind", "where", "says"), NEEDS)
def test_a_fault_that_does_not_fit_its_unit_is_refused(kind: str, where: Callable[[], Surroundings], says: str) -> None:
    options = {"jump": {"size": 1.0}, "spin": {"ratio": 1.0}, "moved_balise": {"offset_m": 1.0}}[kind]
    entry = FaultEntry.model_validate({"unit": "u1", "kind": kind, "from_s": 0.0, **options})
    with pytest.raises(ValueError, match=says):
        Injection(where(), T0, [entry])
