"""The world's process: the truth at every epoch of the grid, from scenario time 0 to the end, once."""

from __future__ import annotations

import pytest

from milepost.nodes.world import WorldNode
from milepost.simulation.motion import Profile, WhiteJerkMotion
from milepost_schemas import Truth

MS = 1_000_000
PERIOD = 20 * MS
T0 = 1_700_000_000 * 1000 * MS


def node(start_ns: int = T0, end_s: float = 1.0) -> WorldNode:
    profile = Profile([(0.0, 10.0), (1.0, 12.0)], 100.0)
    motion = WhiteJerkMotion(profile, end_s, 0.0, None, [0.0] * 3, 1)
    return WorldNode("t1", "w1", motion, motion.end_s, start_ns, PERIOD)


def run(world: WorldNode, step_ns: int = 7 * MS, steps: int = 400) -> list[Truth]:
    out = []
    for k in range(steps):
        out += [output.message for output in world.tick(T0 + k * step_ns)]
    return out


def test_the_truth_is_published_once_per_epoch_until_the_end() -> None:
    world = node()
    told = run(world)
    assert [t.measured_at_ns for t in told] == [T0 + k * PERIOD for k in range(51)]
    assert [t.sequence for t in told] == list(range(51))
    assert world.finished
    assert world.next_tick_ns() is None
    assert list(world.tick(T0 + 100_000 * MS)) == []


def test_the_truth_is_the_motion_at_that_time() -> None:
    told = {t.measured_at_ns: t for t in run(node())}
    half = told[T0 + 500 * MS]
    assert half.position_m == pytest.approx(100.0 + 5.0 + 0.25)
    assert half.speed_mps == pytest.approx(11.0)
    assert half.acceleration_mps2 == pytest.approx(2.0)


@pytest.mark.parametrize("offset_ms", [1, 13, 19])
def test_a_start_off_the_grid_begins_with_the_first_epoch_after_it(offset_ms: int) -> None:
    world = node(T0 + offset_ms * MS)
    first = run(world)[0]
    assert first.measured_at_ns == T0 + PERIOD
    assert first.position_m == pytest.approx(100.0 + 10.0 * (PERIOD - offset_ms * MS) * 1e-9, abs=1e-3)


def test_the_truth_is_published_at_the_requested_tick_within_a_period() -> None:
    world = node()
    for k in range(51):
        due = world.next_tick_ns()
        assert due is not None
        assert T0 + k * PERIOD <= due < T0 + (k + 1) * PERIOD
        assert list(world.tick(due - 1)) == []
        (output,) = world.tick(due)
        assert (output.message.measured_at_ns, output.message.published_at_ns) == (T0 + k * PERIOD, due)


def test_a_late_tick_catches_up() -> None:
    world = node()
    first = world.next_tick_ns()
    assert first is not None
    late = list(world.tick(first + 5 * PERIOD))
    assert [o.message.measured_at_ns for o in late] == [T0 + k * PERIOD for k in range(6)]
    assert {o.message.published_at_ns for o in late} == {first + 5 * PERIOD}
    assert world.next_tick_ns() == first + 6 * PERIOD


def test_the_truth_is_published_outside_the_fusers_subscriptions() -> None:
    assert {(o.stream, o.unit, o.message.unit) for o in node().tick(T0 + PERIOD)} == {("truth", "", "world")}
    assert list(node().subscriptions) == []


def test_without_a_motion_time_ends_and_no_truth_is_published() -> None:
    world = WorldNode("t1", "w1", None, 1.0, T0, PERIOD)
    assert run(world) == []
    assert world.finished
    assert world.end_s == 1.0


def test_a_replacement_node_continues_the_sequence_numbers() -> None:
    """The process builds its node anew once it knows when scenario time begins; what it has said before keeps its number."""
    first, second = node(), node()
    said = [first.event("info", "waiting_for", "waiting for fuser", T0).message.sequence for _ in range(2)]
    second.continue_numbering(first)
    said.append(second.event("info", "x", "", T0).message.sequence)
    assert said == [0, 1, 2]
