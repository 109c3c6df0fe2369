"""The balise service: a telegram becomes a fix where the line says the balise lies, at the time of passage."""

from __future__ import annotations

import pytest

from examples import GAUSSIAN, T0, examples_of, head
from milepost.nodes.balise import BaliseNode
from milepost.track.line import Balise, Line
from milepost_schemas import BY_NAME, STREAMS, AbsoluteFix, BaliseTelegram, Event, Feedback

LINE = Line("l", 1000.0, (Balise("b1", 100.0, 0.05), Balise("b2", 200.5, 12.0)))
NOW = T0 + 500_000_000


def node() -> BaliseNode:
    return BaliseNode("maglev-1", "n1", ["reader-a", "reader-b"], LINE)


def telegram(balise: str, sequence: int = 3) -> BaliseTelegram:
    return BaliseTelegram(**head("reader-a", sequence=sequence), balise_id=balise, reader_variance_m2=0.0004)


def feedback(at_ns: int, low_m: float, high_m: float) -> Feedback:
    bounds = {"position_min_m": low_m, "position_max_m": high_m, "speed_min_mps": 19.0, "speed_max_mps": 21.0}
    return Feedback(**head("fuser", measured_at_ns=at_ns, published_at_ns=at_ns), fused=GAUSSIAN, shares={}, **bounds)


def test_it_subscribes_to_the_trains_readers_and_to_feedback() -> None:
    assert [(s.stream, s.unit, s.newest_only) for s in node().subscriptions] == [
        ("balise_telegram", "reader-a", False),
        ("balise_telegram", "reader-b", False),
        ("feedback", "*", False),
    ]


def test_a_balise_outside_its_window_gives_a_doubtful_fix_and_an_event() -> None:
    service = node()
    assert list(service.step(feedback(telegram("b1").measured_at_ns, 90.0, 94.0), NOW)) == []
    (_, _, fix), (_, _, event) = service.step(telegram("b1"), NOW)
    # 100 m less the front at 94 m, the location accuracy of 0.05 m and the reader's 1 m
    assert fix.doubtful == "balise_early: 4.95 m before its window"
    assert (event.severity, event.code) == ("warning", "balise_early")
    assert fix.position_m == 100.0


def test_a_balise_inside_its_window_gives_a_fix_without_doubt() -> None:
    service = node()
    list(service.step(feedback(telegram("b1").measured_at_ns, 98.0, 102.0), NOW))
    assert [output.message.doubtful for output in service.step(telegram("b1"), NOW)] == [None]


def test_feedback_from_the_future_is_refused_and_expects_nothing() -> None:
    service = node()
    (refused,) = service.step(feedback(NOW + 600_000_000, 90.0, 94.0), NOW)
    assert refused.message.code == "refused_from_future"
    assert service.refusals.counts == {"from_future": 1}
    assert [output.message.doubtful for output in service.step(telegram("b1"), NOW)] == [None]


def test_feedback_whose_interval_ends_before_it_begins_is_invalid() -> None:
    with pytest.raises(ValueError, match="the position interval ends before it begins"):
        feedback(NOW, 94.0, 90.0)


@pytest.mark.parametrize("balise", LINE.balises, ids=lambda b: b.balise_id)
def test_a_telegram_becomes_a_fix_with_the_balises_position_and_passage_time(balise: Balise) -> None:
    said = telegram(balise.balise_id)
    ((stream, unit, fix),) = node().step(said, NOW)
    assert (stream, unit) == ("fix", "balise")
    assert fix == AbsoluteFix(
        train="maglev-1",
        unit="balise",
        instance="n1",
        sequence=0,
        measured_at_ns=said.measured_at_ns,
        published_at_ns=NOW,
        reader="reader-a",
        reader_instance=said.instance,
        reading_sequence=said.sequence,
        balise_id=balise.balise_id,
        position_m=balise.position_m,
        position_variance_m2=0.0004,
        location_accuracy_m=balise.location_accuracy_m,
    )


def test_fixes_are_numbered_without_gaps_and_unknown_balises_take_no_number() -> None:
    service = node()
    sequences = [
        output.message.sequence
        for balise in ("b1", "nowhere", "b2", "b1")
        for output in service.step(telegram(balise), NOW)
        if output.stream == "fix"
    ]
    assert sequences == [0, 1, 2]


def test_a_repeated_telegram_keeps_its_identity() -> None:
    service = node()
    fixes = [output.message for _ in range(2) for output in service.step(telegram("b1", 9), NOW)]
    assert [(f.reader, f.reader_instance, f.reading_sequence) for f in fixes] == [("reader-a", "a1b2c3d4", 9)] * 2


def test_an_unknown_balise_is_counted_and_reported_and_gives_no_fix() -> None:
    service = node()
    for n in (1, 2):
        ((stream, unit, event),) = service.step(telegram("nowhere"), NOW)
        assert (stream, unit) == ("event", "")
        assert isinstance(event, Event)
        assert (event.severity, event.code) == ("warning", "unknown_balise")
        assert "nowhere" in event.text
        assert "reader-a" in event.text
        assert service.refusals.counts == {"unknown_balise": n}
    assert [o.stream for o in service.step(telegram("b1"), NOW)] == ["fix"]


def test_a_line_without_balises_gives_no_fix() -> None:
    service = BaliseNode("maglev-1", "n1", ["reader-a"], Line("l", 1000.0, ()))
    assert [output.stream for output in service.step(telegram("b1"), NOW)] == ["event"]


@pytest.mark.parametrize("row", [row for row in STREAMS if row is not BY_NAME["balise_telegram"]], ids=lambda row: row.name)
def test_other_messages_are_ignored(row: object) -> None:
    for message in examples_of(row):  # type: ignore[arg-type]
        assert list(node().step(message, NOW)) == []


def test_it_asks_for_no_tick() -> None:
    assert node().next_tick_ns() is None
