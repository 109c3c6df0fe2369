"""Several hosts: a train with its router, one at the wayside, one in the control centre, and cables that are pulled out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest
from hosts import Cable, Host, hosts_in_a_row, may_make_hosts

pytestmark = [
    pytest.mark.long,
    pytest.mark.system,
    pytest.mark.skipif(not may_make_hosts(), reason="network namespaces cannot be made here"),
]
FRESH_NS = 200_000_000
HEALED_S = 1.0
# what other work on the machine may add
SHARED_S = 0.5
ON_BOARD, CENTRE = "tcp/127.0.0.1:7447", "tcp/127.0.0.1:7447"

Hosts = tuple[list[Host], list[Cable]]


def wait(what: Callable[[], bool], timeout_s: float, why: str) -> None:
    deadline = time.monotonic() + timeout_s
    while not what():
        assert time.monotonic() < deadline, f"not within {timeout_s:g} s: {why}"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def three() -> Iterator[Hosts]:
    with hosts_in_a_row("train", "wayside", "centre") as (hosts, cables):
        train, wayside, centre = hosts
        train.milepost("up", "--headless", "--listen", ON_BOARD, "--listen", "tcp/10.79.0.1:7447")
        wayside.milepost("run", "router", "--listen", "tcp/10.79.1.1:7447", "--link", "tcp/10.79.0.1:7447")
        centre.milepost("run", "router", "--listen", CENTRE, "--link", "tcp/10.79.1.1:7447")
        # a listener gives up where no router is yet
        wait(lambda: _listening(train, ON_BOARD) and _listening(centre, CENTRE), 40.0, "both hosts hear states")
        wait(lambda: centre.states[-1][3] == "normal", 40.0, "a normal state in the control centre")
        yield hosts, cables


def _listening(host: Host, endpoint: str) -> bool:
    listeners = [process for process in host.processes if process.stdin is not None]
    if not any(process.poll() is None for process in listeners):
        host.listen(endpoint)
    return bool(host.states)


@pytest.mark.parametrize(("cable", "seconds"), [(0, 2.0), (1, 2.0), (0, 8.0)], ids=["train", "centre", "train-for-long"])
def test_the_train_goes_on_and_the_centre_has_the_newest_state_a_second_after_healing(
    three: Hosts, cable: int, seconds: float
) -> None:
    (train, _, centre), cables = three
    begun, begun_ns = len(train.states), time.time_ns()
    healed_ns = cables[cable].out_for(seconds)

    def fresh() -> list[int]:
        return [at for at, _, measured, _ in list(centre.states) if at > healed_ns and at - measured < FRESH_NS]

    wait(lambda: bool(fresh()), 10.0, "a fresh state in the control centre")
    assert (fresh()[0] - healed_ns) * 1e-9 < HEALED_S + SHARED_S
    away = [at for at, *_ in list(centre.states) if begun_ns + FRESH_NS < at < healed_ns]
    assert not away, "the cable was not out"
    on_board = list(train.states)[begun:]
    epochs = [epoch for _, epoch, *_ in on_board]
    assert set(epochs) == set(range(epochs[0], epochs[-1] + 1)), "an epoch is missing on board"
    assert {status for *_, status in on_board} == {"normal"}
    assert max(b - a for (a, *_), (b, *_) in pairwise(on_board)) * 1e-9 < 0.1 + SHARED_S
