"""Balise linking by hand: windows of a small line, and each irregularity with its evidence."""

from __future__ import annotations

import pytest

from milepost.track.line import Balise, Line
from milepost.track.linking import Linking
from milepost.track.passage import Interval, Irregularity, Telegram

S = 1_000_000_000
T0 = 1_700_000_000 * S
# windows reach 1 m (reader) and 0.5 m (location) beyond each end of the interval
LINE = Line("l", 1000.0, tuple(Balise(f"b{i}", 100.0 * i, 0.5) for i in range(1, 8)))


def at(t_s: float) -> int:
    return T0 + round(t_s * S)


class Drive:
    """A train whose interval is the truth ± `half_m`, ± 0.5 m/s, published every 100 ms; it begins at 50 m and 0 s."""

    def __init__(self, speed_mps: float = 10.0, from_m: float = 50.0, half_m: float = 1.0) -> None:
        self.linking = Linking(LINE)
        self.t_s, self.at_m, self.speed_mps, self.half_m = 0.0, from_m, speed_mps, half_m
        self.codes: list[str] = []
        self.texts: list[str] = []
        self.follow()

    def follow(self) -> None:
        s, v = self.at_m, self.speed_mps
        self._note(self.linking.follow(Interval(at(self.t_s), s - self.half_m, s + self.half_m, v - 0.5, v + 0.5)))

    def go(self, to_s: float, speed_mps: float | None = None) -> None:
        self.speed_mps = self.speed_mps if speed_mps is None else speed_mps
        while self.t_s < to_s - 0.05:
            self.t_s += 0.1
            self.at_m += 0.1 * self.speed_mps
            self.follow()

    def read(self, number: int, reader: str = "reader", at_s: float | None = None) -> str | None:
        """Read balise `number`; returns why its fix is doubtful."""
        taken = self.linking.take(Telegram(reader, number - 1, at(self.t_s if at_s is None else at_s), 0.0004))
        self._note(taken.found)
        return next((found.detail for found in taken.found if found.detail), None)

    def _note(self, found: list[Irregularity]) -> None:
        self.codes += [f.code for f in found if f.text]
        self.texts += [f.text for f in found if f.text]


class TestInterval:
    known = Interval(T0, 90.0, 94.0, 19.0, 21.0)

    def test_ahead_of_its_time_each_bound_moves_with_its_own_speed(self) -> None:
        later = self.known.carried(at(0.5))
        # 90 + 19/2 - 3/8, 94 + 21/2 + 3/8; ± 3/2 m/s
        assert later == pytest.approx((at(0.5), 99.125, 104.875, 17.5, 22.5))

    def test_before_its_time_it_becomes_wider_too(self) -> None:
        assert self.known.carried(at(-0.5)) == pytest.approx((at(-0.5), 79.125, 84.875, 17.5, 22.5))

    def test_a_train_that_may_stand_has_no_direction(self) -> None:
        assert [Interval(T0, 0, 1, low, low + 1.0).direction for low in (0.5, -0.5, -2.0)] == [1, 0, -1]


def test_without_an_interval_nothing_is_refused() -> None:
    linking = Linking(LINE)
    assert linking.take(Telegram("reader", 4, T0, 0.0004)).found == []


def test_an_interval_older_than_a_second_refuses_nothing() -> None:
    drive = Drive()
    assert drive.read(7, at_s=0.9) is not None
    assert drive.read(6, at_s=1.1) is None


def test_balises_that_are_read_in_their_windows_are_regular() -> None:
    drive = Drive()
    for number in range(1, 6):
        drive.go(10.0 * number - 5.0)
        assert drive.read(number) is None
    drive.go(48.0)
    assert drive.codes == []


class TestMissed:
    def test_it_is_told_once_when_the_window_and_the_latency_are_over(self) -> None:
        drive = Drive()
        # the rear is beyond 101.5 m for the first time at 5.3 s; a telegram may be 1 s late
        drive.go(6.3)
        assert drive.codes == []
        drive.go(6.4)
        assert drive.codes == ["balise_missed"]
        drive.go(14.9)
        assert drive.codes == ["balise_missed"]
        assert "b1 at 100.00 m was not read" in drive.texts[0]
        assert "the train was at 102.00 to 104.00 m when its window closed" in drive.texts[0]

    def test_a_telegram_within_the_latency_is_not_missed(self) -> None:
        drive = Drive()
        drive.go(6.0)
        assert drive.read(1, at_s=5.0) is None
        drive.go(9.0)
        assert drive.codes == []

    def test_two_in_a_row_are_a_fault_and_the_end_of_it_is_told(self) -> None:
        drive = Drive()
        drive.go(34.0)
        assert drive.codes == ["balise_missed", "balise_missed", "balises_missed"]
        assert "b1 and b2 were missed in a row" in drive.texts[2]
        drive.go(35.0)
        assert drive.read(4) is None
        assert drive.codes[3:] == ["balises_read_again"]
        assert "after 3 missed" in drive.texts[3]

    def test_two_with_one_read_between_are_no_fault(self) -> None:
        drive = Drive()
        drive.go(15.0)
        drive.read(2)
        drive.go(28.0)
        assert drive.codes == ["balise_missed", "balise_missed"]

    def test_a_train_that_turns_round_before_the_balise_missed_none(self) -> None:
        drive = Drive()
        drive.go(4.9)
        drive.go(9.0, speed_mps=-10.0)
        assert drive.codes == []

    def test_a_balise_that_a_train_begins_over_is_not_expected(self) -> None:
        drive = Drive(from_m=100.0)
        drive.go(5.0)
        assert drive.codes == []

    def test_an_interval_that_jumps_expects_nothing_that_it_jumped_over(self) -> None:
        drive = Drive()
        drive.go(1.0)
        drive.at_m = 450.0
        drive.go(3.0)
        assert drive.codes == []


class TestBackwards:
    def test_balises_that_are_read_in_falling_order_are_regular(self) -> None:
        drive = Drive(speed_mps=-10.0, from_m=350.0)
        for number in (3, 2, 1):
            drive.go(10.0 * (4 - number) - 5.0)
            assert drive.read(number) is None
        drive.go(28.0)
        assert drive.codes == []

    def test_a_balise_that_is_passed_unread_is_missed(self) -> None:
        drive = Drive(speed_mps=-10.0, from_m=350.0)
        drive.go(8.0)
        assert drive.codes == ["balise_missed"]

    def test_a_balise_that_is_read_at_once_again_after_turning_is_regular(self) -> None:
        drive = Drive()
        drive.go(5.0)
        drive.read(1)
        drive.go(5.2)
        drive.go(5.4, speed_mps=-10.0)
        assert drive.read(1) is None
        assert drive.codes == []


def test_a_balise_before_its_window_is_early_by_the_distance() -> None:
    drive = Drive()
    drive.go(4.0)
    # at 90 m: the front at 91 m, and 1.5 m of tolerance
    assert drive.read(1) == "balise_early: 7.50 m before its window"
    drive.go(8.0)
    assert drive.codes == ["balise_early"]


def test_a_balise_behind_its_window_is_late_by_the_distance() -> None:
    drive = Drive()
    drive.go(6.0)
    assert drive.read(1) == "balise_late: 7.50 m behind its window"
    drive.go(8.0)
    assert drive.codes == ["balise_late"]


def test_a_train_that_goes_back_reads_early_what_lies_behind_its_window() -> None:
    drive = Drive(speed_mps=-10.0, from_m=350.0)
    drive.go(4.0)
    assert drive.read(3) == "balise_early: 7.50 m before its window"


def test_a_balise_beyond_another_one_is_unexpected() -> None:
    drive = Drive()
    assert drive.read(3) == "balise_unexpected: 247.50 m outside its window, beyond another balise"
    assert drive.codes == ["balise_unexpected"]


def test_a_later_balise_first_is_out_of_order_and_told_once() -> None:
    drive = Drive()
    drive.go(5.0)
    drive.read(1)
    drive.go(15.0)
    assert drive.read(3) == "balise_out_of_order: before b2"
    drive.go(15.1)
    assert drive.read(3) == "balise_out_of_order: before b2"
    assert drive.codes == ["balise_out_of_order"]


def test_a_balise_after_a_missed_one_is_in_order() -> None:
    drive = Drive()
    drive.go(5.0)
    drive.read(1)
    drive.go(25.0)
    assert drive.read(3) is None
    assert drive.codes == ["balise_missed"]


@pytest.mark.parametrize("half_m", [1.0, 150.0], ids=["outside its window", "inside its window"])
def test_a_balise_behind_the_last_one_is_against_the_travel(half_m: float) -> None:
    drive = Drive(half_m=half_m)
    drive.go(15.0)
    drive.read(2)
    drive.go(16.0)
    assert drive.read(1) == "balise_wrong_direction: against the direction of travel after b2"


class TestRepeated:
    def test_a_moving_train_that_reads_a_balise_again_has_a_doubtful_fix(self) -> None:
        drive = Drive()
        drive.go(5.0)
        assert drive.read(1) is None
        drive.go(5.1)
        assert drive.read(1) == "balise_repeated: read again by a train that moves"
        assert drive.codes == ["balise_repeated"]

    def test_a_standing_train_may_read_a_balise_again(self) -> None:
        drive = Drive()
        drive.go(5.0)
        assert drive.read(1) is None
        for t_s in (5.1, 7.0, 30.0):
            drive.go(t_s, speed_mps=0.0)
            assert drive.read(1) is None
        drive.go(35.0, speed_mps=10.0)
        assert drive.codes == []

    def test_a_second_reader_may_read_the_balise_too(self) -> None:
        drive = Drive()
        drive.go(5.0)
        assert drive.read(1) is None
        assert drive.read(1, reader="other") is None
        assert drive.codes == []

    def test_a_telegram_that_comes_twice_is_one_telegram(self) -> None:
        drive = Drive()
        drive.go(5.0)
        assert drive.read(1) is None
        assert drive.read(1) is None
        assert drive.codes == []
