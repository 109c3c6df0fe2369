"""What a soak makes of samples of memory and of epochs that are missing, by hand."""

from __future__ import annotations

from milepost.chaos.soak import Blow, _growths, _missing_elsewhere, _repeated_after
from milepost_schemas import FusedState

PERIOD_NS = 20_000_000


def received(*epochs: int) -> list[tuple[int, FusedState]]:
    return [(n * PERIOD_NS, FusedState.model_construct(epoch=n, measured_at_ns=n * PERIOD_NS)) for n in epochs]


def test_two_processes_of_a_name_are_not_compared_with_each_other() -> None:
    samples = [("fuser", 1, 8.0), ("fuser", 1, 8.2), ("fuser", 2, 50.0), ("fuser", 2, 50.5), ("world", 3, 7.0)]
    assert _growths(samples) == {"fuser": (8.0, 8.2), "world": (7.0, 7.0)}


def test_an_epoch_is_missing_where_neither_a_blow_nor_a_stall_excuses_it() -> None:
    heard = received(*range(100, 110), *range(112, 120), *range(121, 130), *range(132, 140))
    blow = Blow(110 * PERIOD_NS, 111 * PERIOD_NS, "fuser killed")
    assert _missing_elsewhere(heard, [blow], [(120 * PERIOD_NS, 120 * PERIOD_NS)]) == 2


def test_states_that_come_twice_are_told_by_the_blow_before_them() -> None:
    heard = received(*range(100, 110), 109, *range(110, 120), 118, 119)
    heard = [(100 * PERIOD_NS + place * PERIOD_NS, state) for place, (_, state) in enumerate(heard)]
    blows = [Blow(105 * PERIOD_NS, 0, "router killed"), Blow(115 * PERIOD_NS, 0, "fuser killed")]
    assert _repeated_after(heard, blows) == {"router killed, 0 s": 1, "fuser killed, 0 s": 2}
