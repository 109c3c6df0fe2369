"""Waiting for what is heard: whoever looks takes his time, and whoever hears does not wait for him."""

from __future__ import annotations

import threading
import time

import pytest

from milepost.chaos.news import News, NotInTime


def test_who_hears_does_not_wait_for_who_looks() -> None:
    """A look through all processes took 0.1 s; receipts that had to wait for it were stamped late, as gaps of the train's."""
    news, looking, may_end = News(), threading.Event(), threading.Event()

    def looks() -> bool:
        looking.set()
        return may_end.wait(10.0)

    waiter = threading.Thread(target=news.wait_for, args=(looks, 20.0, "the end"))
    waiter.start()
    assert looking.wait(10.0)
    hears = threading.Thread(target=news.heard)
    hears.start()
    hears.join(5.0)
    stuck = hears.is_alive()
    may_end.set()
    waiter.join(10.0)
    assert not stuck
    assert not waiter.is_alive()


def test_what_came_while_somebody_looked_is_looked_at_at_once() -> None:
    news, heard, looks = News(), list[int](), list[float]()

    def looked() -> bool:
        looks.append(time.monotonic())
        if len(looks) == 1:
            # comes after this look has begun, and is not in what it says
            heard.append(1)
            news.heard()
            return False
        return bool(heard)

    assert news.wait_for(looked, 10.0, "one")
    assert looks[1] - looks[0] < 0.4, "it waited for the next news"


def test_what_does_not_come_is_said() -> None:
    with pytest.raises(NotInTime, match=r"not within 0\.05 s: the train recovered"):
        News().wait_for(lambda: False, 0.05, "the train recovered")


def test_what_is_there_already_is_given_back() -> None:
    assert News().wait_for(lambda: "here", 0.0, "it") == "here"
