"""By how much a process's clock is ahead of the others', by hand."""

from __future__ import annotations

from milepost.nodes.clocks.own_clock import OwnClock

MS = 1_000_000
NOW_MS = 10_000


def heard(*ways: tuple[str, int, int]) -> OwnClock:
    """Messages as (sender, when heard in ms, ms on the way by the clocks of both)."""
    clock = OwnClock()
    for sender, at_ms, way_ms in ways:
        clock.heard(sender, (at_ms - way_ms) * MS, at_ms * MS)
    return clock


def test_of_one_sender_nothing_follows() -> None:
    assert heard(("radar", NOW_MS, 500)).ahead_ns() is None


def test_more_than_half_of_the_senders_must_say_it() -> None:
    """Of 0, 0, 500, 500 ms the two in the middle are 0 and 500: the nearer to 0 counts. Of 0, 500, 500 the middle is 500."""
    half = [("a", NOW_MS, 0), ("b", NOW_MS, 0), ("c", NOW_MS, 500), ("d", NOW_MS, 500)]
    assert heard(*half).ahead_ns() == 0
    assert heard(*half[1:]).ahead_ns() == 500 * MS


def test_messages_from_the_future_show_a_clock_that_is_behind() -> None:
    assert heard(("a", NOW_MS, -200), ("b", NOW_MS, -180)).ahead_ns() == -180 * MS


def test_messages_that_wait_now_and_then_do_not_show_a_clock_that_is_ahead() -> None:
    """The fastest of the last 250 to 500 ms counts: 5 ms, though the last message took 300."""
    waited = [each for unit in "ab" for each in ((unit, NOW_MS - 100, 5), (unit, NOW_MS, 300))]
    assert heard(*waited).ahead_ns() == 5 * MS


def test_what_was_heard_long_ago_does_not_count() -> None:
    old = [("a", NOW_MS - 1000, 0), ("b", NOW_MS - 1000, 0)]
    new = [("c", NOW_MS, 400), ("d", NOW_MS, 400)]
    assert heard(*old, *new, *new).ahead_ns() == 400 * MS


def test_a_clock_that_stands_still_is_further_behind_with_each_message() -> None:
    """What a sender that has ended said last does not count for long, though no time goes by here."""
    clock = OwnClock()
    clock.heard("ended", NOW_MS * MS, NOW_MS * MS)
    for published_ms in range(NOW_MS, NOW_MS + 3000, 10):
        for unit in "abc":
            clock.heard(unit, published_ms * MS, NOW_MS * MS)
    assert clock.ahead_ns() == -2990 * MS
