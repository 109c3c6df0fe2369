"""What `up` says while a train starts."""

from __future__ import annotations

from milepost.cli.arrivals import Arrivals


def test_each_process_is_named_once_as_it_comes_and_then_the_first_state() -> None:
    said: list[str] = []
    arrivals = Arrivals(["router", "fuser", "world"], said.append, lambda: 2.04)
    for name in ("router", "fuser", "fuser", "a-stranger"):
        arrivals.came(name)
    assert arrivals.missing == ["world"]
    arrivals.state()
    arrivals.state()
    assert said == ["router is there (1 of 3)", "fuser is there (2 of 3)", "first state after 2.0 s"]
    assert arrivals.done
