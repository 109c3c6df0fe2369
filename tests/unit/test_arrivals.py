"""What `up` says while a train starts."""

from __future__ import annotations

from milepost.cli.showing.arrivals import Arrivals


def test_of_several_trains_each_is_named_and_has_a_first_state() -> None:
    said: list[str] = []
    arrivals = Arrivals(["router", "a fuser", "b fuser"], ["a", "b"], said.append, lambda: 2.04)
    arrivals.came("router")
    arrivals.came("fuser", "b")
    arrivals.came("fuser", "stranger")
    arrivals.state("b")
    arrivals.state("stranger")
    assert (arrivals.missing, arrivals.done) == (["a fuser"], False)
    arrivals.state("a")
    assert arrivals.done
    assert said == [
        "router is there (1 of 3)",
        "b fuser is there (2 of 3)",
        "b: first state after 2.0 s",
        "a: first state after 2.0 s",
    ]


def test_each_process_is_named_once_as_it_comes_and_then_the_first_state() -> None:
    said: list[str] = []
    arrivals = Arrivals(["router", "fuser", "world"], ["maglev-1"], said.append, lambda: 2.04)
    for name in ("router", "fuser", "fuser", "a-stranger"):
        arrivals.came(name)
    assert arrivals.missing == ["world"]
    arrivals.state("maglev-1")
    arrivals.state("maglev-1")
    assert said == ["router is there (1 of 3)", "fuser is there (2 of 3)", "first state after 2.0 s"]
    assert arrivals.done
