"""A host whose clock is two seconds off: a real process there, whose every clock call libfaketime shifts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from lighter import lighter
from milepost.chaos.stack import Stack

LIBRARY = next(iter(sorted(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"))), None)
pytestmark = [
    pytest.mark.long,
    pytest.mark.system,
    pytest.mark.skipif(LIBRARY is None, reason="no libfaketime: apt-get install libfaketime"),
]
BACK_S, TOLD_S, GAP_S = 30.0, 20.0, 1.0
HEARD = 30


@pytest.fixture(scope="module")
def milepost_train(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The train on several hosts."""
    return str(lighter("full", tmp_path_factory.mktemp("train")))


@pytest.fixture(scope="module")
def train(milepost_train: str) -> Iterator[Stack]:
    """One train for all cases."""
    with Stack(milepost_train) as stack:
        yield stack


@pytest.mark.parametrize("off", ["+2s", "-2s"])
@pytest.mark.parametrize("process", ["fuser", "fuser-2", "filter-odometer-front"])
def test_a_process_on_a_host_whose_clock_is_two_seconds_off_is_of_use(
    train: Stack, process: str, off: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a train WHEN a process moves to such a host THEN it says so, no state is late or missing, all units count."""
    train.recovered(BACK_S)
    begun = len(train.events)
    with train.measured() as seen:
        train.terminate(process)
        with monkeypatch.context() as there:
            there.setenv("LD_PRELOAD", str(LIBRARY))
            there.setenv("FAKETIME", off)
            train.start(process)
        train.back(process, BACK_S)
        told = f"{process}: its clock is "
        train.wait_for(
            lambda: any(e.code == "clock_wrong" and e.text.startswith(told) for e in train.events[begun:]), TOLD_S, "it says so"
        )
        # well again with the process where it is
        train.recovered(BACK_S)
        heard = len(train.states)
        train.wait_for(lambda: len(train.states) >= heard + HEARD, TOLD_S, f"{HEARD} states more")
    assert seen.own_gap_s <= GAP_S
    assert (seen.violations, seen.contradicted) == (0, 0)
    assert seen.compared > 0
    assert all(-1e8 < at_ns - state.measured_at_ns < 1e9 for at_ns, state in train.witness.received[-HEARD:])
    # back to a host whose clock is right
    train.kill(process)
    train.back(process, BACK_S)
