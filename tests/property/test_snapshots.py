"""What a fuser hands over is taken as it was, bit for bit; anything else is refused with a reason, and moves nobody."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from milepost.config.roles import ROLES, Setting
from milepost.config.train import Train, load_train
from milepost.config.yaml_files import ConfigError
from milepost.estimation.filters import FILTERS
from milepost.nodes.base import Output
from milepost.nodes.catching_up.codec import Misfit, like, of, record
from milepost.nodes.catching_up.snapshot import Memory, Snapshots
from milepost.nodes.fuser import FuserNode
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost.simulation.faults import FaultEntry
from milepost_schemas import Feedback, Message, Refused, SnapshotPart

TRAINS = Path(__file__).parents[2] / "deploy/trains"
S = 1_000_000_000
# so that there is a bank before the settled boundary
SHORT = {"horizon_s": 0.5}
BIAS = {"kind": "bias", "size": 2.0, "from_s": 1.5}


class Asked:
    """A fuser that has run for a while, and what it hands over then."""

    def __init__(self, train: Train, until_s: float = 3.0, lie: Mapping[str, Any] | None = None) -> None:
        self.train, self.now_ns = train, OFFLINE_START_NS + round(until_s * S)
        self.fuser = fuser(train)

        def tap(output: Output, now_ns: int) -> None:
            if output.stream in ("estimate", "fix"):
                list(self.fuser.step(output.message, now_ns))

        simulate(train, until_s, tap, faults=[FaultEntry.model_validate(lie)] if lie else [])
        list(self.fuser.tick(self.now_ns))
        self.parts = list(self.fuser.hand_over(self.now_ns))

    @property
    def agreed(self) -> Feedback:
        answer = self.fuser.answer("latest_feedback")
        assert isinstance(answer, Feedback)
        return answer

    def opened(self, parts: list[SnapshotPart] | None = None) -> Memory:
        return snapshots_of(fuser(self.train)).opened(self.parts if parts is None else parts, self.now_ns)


def fuser(train: Train) -> FuserNode:
    node = ROLES["fuser"].build(train, "fuser", Setting("test"))
    assert isinstance(node, FuserNode)
    return node


def snapshots_of(node: FuserNode) -> Snapshots:
    assert node._snapshots is not None
    return node._snapshots


def same(a: Any, b: Any) -> bool:
    """Whether two values are of the same kinds and bits, down to the last part."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes() and a.flags.forc == b.flags.forc
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if hasattr(a, "sets"):  # rows follow from these
        return (a.sets, a.excluded, a.alternatives, a.blamed) == (b.sets, b.excluded, b.alternatives, b.blamed)
    return a == b or (a != a and b != b)


def known_by(node: FuserNode) -> Memory:
    kept = node._rule.kept()
    assert kept is not None
    parts = node._epochs.times, node._roster.memory, node._writer.memory, node._decisions.memory, node._feedback
    return Memory(*parts, kept)


@pytest.mark.parametrize("path", sorted(TRAINS.glob("*.yaml")), ids=lambda path: path.stem)
def test_what_a_fuser_of_any_train_knows_is_the_same_after_the_way(path: Path) -> None:
    try:
        asked = Asked(load_train(path, {"fusion": SHORT}))
    except ConfigError as error:
        pytest.skip(str(error))
    assert asked.parts
    assert asked.opened().kept.base.since_ns is not None
    assert same(asked.opened(), known_by(asked.fuser))


@pytest.mark.parametrize("kind", sorted(FILTERS))
def test_what_was_learned_with_any_filter_is_the_same_after_the_way(kind: str) -> None:
    change = {"units": {unit: {"filter": kind} for unit in ("radar", "loop")}, "fusion": SHORT}
    asked = Asked(load_train(TRAINS / "maglev.yaml", change), 2.5, {"unit": "radar", **BIAS})
    memory = asked.opened()
    assert same(memory, known_by(asked.fuser))
    learns = FILTERS[kind].learner(FILTERS[kind].options_model()) is not None
    assert bool(memory.kept.base.verdicts["radar"].noise) == learns


def test_an_excluded_unit_is_excluded_after_the_way() -> None:
    asked = liar()
    assert asked.fuser.rule.state_at(asked.now_ns, {}).verdicts["radar-front"].excluded  # type: ignore[union-attr]
    taker = fuser(asked.train)
    taker.take_over(asked.parts, asked.agreed, asked.now_ns)
    assert same(known_by(taker), known_by(asked.fuser))
    assert same(taker.rule.state_at(asked.now_ns, {}), asked.fuser.rule.state_at(asked.now_ns, {}))


@cache
def liar() -> Asked:
    return Asked(load_train(TRAINS / "full.yaml", {"fusion": SHORT}), 3.5, {"unit": "radar-front", **BIAS})


@cache
def honest() -> Asked:
    return Asked(load_train(TRAINS / "maglev.yaml", {"fusion": SHORT}), 2.0)


@cache
def nobody() -> tuple[FuserNode, Memory]:
    node = fuser(honest().train)
    return node, known_by(node)


def refused(parts: list[SnapshotPart], agreed: Feedback | None = None, now_ns: int | None = None) -> Refused:
    """Why a fuser that knows nothing refuses it; it then knows nothing still."""
    node, before = nobody()
    with pytest.raises(Refused) as found:
        node.take_over(parts, agreed or honest().agreed, honest().now_ns if now_ns is None else now_ns)
    assert same(known_by(node), before)
    assert found.value.detail
    return found.value


def changed(number: int, **fields: Any) -> list[SnapshotPart]:
    return [part.model_copy(update=fields) if part.part == number else part for part in honest().parts]


def test_a_snapshot_of_another_train_file_or_version_is_refused() -> None:
    assert refused(changed(0, fingerprint="0")).reason == "other_settings"
    other = load_train(TRAINS / "maglev.yaml", {"fusion": {**SHORT, "integrity_risk_per_hour": 1e-5}})
    parts = [part.model_copy(update={"fingerprint": fuser(other)._settings.fingerprint}) for part in honest().parts]
    assert refused(parts).reason == "other_settings"


def test_the_fingerprint_is_the_same_wherever_the_line_lies_and_whatever_the_train_does() -> None:
    train = honest().train
    elsewhere = dataclasses.replace(train, file=train.file.model_copy(update={"line": Path("/elsewhere"), "chaos": True}))
    assert fuser(elsewhere)._settings.fingerprint == fuser(train)._settings.fingerprint


@pytest.mark.parametrize(("late_ns", "reason"), [(S + 1, "too_old"), (-S, "too_old")])
def test_a_snapshot_of_another_time_is_refused(late_ns: int, reason: str) -> None:
    assert refused(honest().parts, now_ns=honest().now_ns + late_ns).reason == reason


def test_parts_that_are_missing_or_come_twice_are_refused() -> None:
    parts = honest().parts
    assert len(parts) > 1
    for wrong in (parts[1:], parts[:-1], [], [*parts, parts[0]]):
        assert refused(wrong).reason == "incomplete"


def test_a_belief_that_most_processes_contradict_is_refused() -> None:
    told = honest().agreed
    mean = [told.fused.mean[0] + 50.0, *told.fused.mean[1:]]
    agreed = told.model_copy(update={"fused": told.fused.model_copy(update={"mean": mean})})
    assert "contradicts" in refused(honest().parts, agreed).detail


def test_a_rule_without_a_bank_hands_nothing_over() -> None:
    asked = Asked(load_train(TRAINS / "beidou-maglev.yaml", {"fusion": {"rule": "federated"}}), 2.0)
    assert asked.agreed
    assert asked.parts == []
    with pytest.raises(Refused, match="no bank"):
        asked.fuser.take_over(honest().parts, asked.agreed, asked.now_ns)


def test_a_fuser_that_has_begun_no_epoch_hands_nothing_over() -> None:
    assert list(fuser(honest().train).hand_over(honest().now_ns)) == []


@pytest.mark.parametrize(("train", "peers"), [("full", ["fuser-2"]), ("full-2oo3", []), ("maglev", [])])
def test_replicas_copy_each_other_and_fusers_with_a_voter_do_not(train: str, peers: list[str]) -> None:
    live = load_train(TRAINS / f"{train}.yaml")
    node = ROLES["fuser"].build(live, "fuser", Setting("test", live=True))
    assert list(node.peers) == peers


def content_of(part: SnapshotPart) -> Any:
    return msgpack.unpackb(part.content)


def leaves(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(leaf for key, each in items for leaf in leaves(each, (*path, key)))]


def with_leaf(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    if not path:
        return new
    out = dict(value) if isinstance(value, dict) else list(value)
    out[path[0]] = with_leaf(out[path[0]], path[1:], new)
    return out


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    st.floats(allow_nan=True),
    st.text(max_size=4),
    st.binary(max_size=32),
    st.lists(st.integers(0, 3), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)


def takes_or_refuses(parts: list[SnapshotPart]) -> None:
    """No other exception; and what is taken goes on, or is what most remember."""
    node = fuser(honest().train)
    now_ns = honest().now_ns
    try:
        node.take_over(parts, honest().agreed, now_ns)
    except Refused:
        return
    state = node.rule.state_at(now_ns, {})
    assert state is not None
    assert abs(state.mean[0] - honest().agreed.fused.mean[0]) < 2.0
    list(node.tick(now_ns + S // 50))


SLOW = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))


@SLOW
@given(data=st.data())
def test_a_snapshot_of_which_anything_was_replaced_is_refused_or_harmless(data: st.DataObject) -> None:
    number = data.draw(st.integers(0, len(honest().parts) - 1))
    content = content_of(honest().parts[number])
    path = data.draw(st.sampled_from(leaves(content)))
    forged = msgpack.packb(with_leaf(content, path, data.draw(ANYTHING)))
    takes_or_refuses(changed(number, content=forged))


@SLOW
@given(number=st.integers(0, 1), cut=st.floats(0.0, 1.0), more=st.binary(max_size=8))
def test_a_truncated_snapshot_is_refused(number: int, cut: float, more: bytes) -> None:
    content = honest().parts[number].content
    short = content[: int(cut * len(content))] + more
    if short != content:
        takes_or_refuses(changed(number, content=short))


@SLOW
@given(number=st.integers(0, 1), where=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_snapshot_with_a_flipped_bit_is_refused_or_harmless(number: int, where: float, bit: int) -> None:
    content = bytearray(honest().parts[number].content)
    content[int(where * len(content))] ^= 1 << bit
    takes_or_refuses(changed(number, content=bytes(content)))


@SLOW
@given(number=st.integers(0, 1), garbage=st.binary(max_size=200))
def test_garbage_is_refused(number: int, garbage: bytes) -> None:
    assert refused(changed(number, content=garbage)).reason in ("invalid", "undecodable")


def test_what_is_of_no_known_kind_cannot_be_handed_over() -> None:
    def misfits(way: Callable[[], Any]) -> None:
        with pytest.raises(Misfit):
            way()

    misfits(lambda: of(Callable[[], int]))
    misfits(lambda: of(object))
    misfits(lambda: like(object()))
    misfits(lambda: of(int).pack(True))
    misfits(lambda: of(tuple[int, ...]).pack([1]))
    misfits(lambda: of(dict[str, int]).pack({1: 1}))
    misfits(lambda: record(Memory, kept=of(int)).pack(("one",)))


@pytest.mark.parametrize("value", [0.1, -0.0, float("inf"), np.float64(0.1)])
def test_a_number_keeps_its_bits_and_its_kind(value: float) -> None:
    coder = of(float)
    back = coder.unpack(msgpack.unpackb(msgpack.packb(coder.pack(value))))
    assert type(back) is type(value)
    assert np.float64(back).tobytes() == np.float64(value).tobytes()


def test_an_array_keeps_the_order_of_its_memory() -> None:
    for a in (np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6.0).reshape(2, 3)), np.arange(12.0)[::2]):
        coder = like(a)
        back = coder.unpack(msgpack.unpackb(msgpack.packb(coder.pack(a))))
        assert (back == a).all()
        assert back.flags.f_contiguous == a.flags.f_contiguous or not a.flags.forc
        assert back.flags.writeable


def test_messages_are_taken_as_their_schema_says() -> None:
    coder = of(Feedback)
    agreed: Message = honest().agreed
    assert coder.unpack(coder.pack(agreed)) == agreed
    with pytest.raises(Misfit):
        coder.unpack(b"garbage")
