"""Balise linking on the memory bus, GIVEN a train, WHEN a balise or its telegram is not as the line says, THEN it is told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, ClassVar

import pytest
from harness import MAGLEV, ROOT, at, scenario_s, travel

from milepost.config.roles import ROLES, Setting, processes
from milepost.config.train import Train, load_train
from milepost.nodes.balise import BaliseNode
from milepost.nodes.base import Output
from milepost.offline.memory_bus import Tap
from milepost.offline.run import OFFLINE_START_NS, OfflineRun, simulate
from milepost.simulation.faults import Fault, silent
from milepost.track.line import Balise, Line
from milepost_schemas import AbsoluteFix, BaliseTelegram, Event

pytestmark = pytest.mark.long

METRO, FULL = ROOT / "deploy/trains/metro.yaml", ROOT / "deploy/trains/full.yaml"
READER = "sensor-balise-reader"
# at 20 m/s the default train passes b00001 at some 5 s, and one more each 5 s
BETWEEN_S = 7.5


def telegram(balise: str, at_s: float, sequence: int = 0) -> tuple[float, Output]:
    head = {"train": "maglev-1", "unit": "balise-reader", "instance": "another", "sequence": sequence}
    stamps = {"measured_at_ns": at(at_s), "published_at_ns": at(at_s + 0.01)}
    message = BaliseTelegram(**head, **stamps, balise_id=balise, reader_variance_m2=0.0004)
    return at_s + 0.01, Output("balise_telegram", "balise-reader", message)


def codes(events: list[Event]) -> list[str]:
    return [e.code for e in events if e.unit == "balise"]


def lost(*balises: str) -> dict[str, Fault]:
    """The reader does not read these balises."""
    return {READER: lambda t_s, message: None if getattr(message, "balise_id", "") in balises else 0.0}


class TestMissed:
    def test_a_missed_balise_is_told_when_its_window_has_closed(self):
        journey = travel(13.0, lost("b00002"))
        (event,) = [e for e in journey.events if e.unit == "balise"]
        assert event.code == "balise_missed"
        assert "b00002 at 200.00 m" in event.text
        passed_s = next(scenario_s(t) for t in journey.truth.values() if t.position_m >= 200.0)
        # 1 s of latency, and the train's way through the rest of the window
        assert passed_s + 1.0 < scenario_s(event) < passed_s + 1.5

    def test_a_reader_that_reads_nothing_is_a_fault_after_two_balises(self):
        journey = travel(24.0, {READER: silent(0.0, 99.0)})
        assert codes(journey.events)[:3] == ["balise_missed", "balise_missed", "balises_missed"]
        fault = next(e for e in journey.events if e.code == "balises_missed")
        assert fault.severity == "error"
        assert "b00001 and b00002" in fault.text
        assert len(codes(journey.events)) == 3

    def test_without_feedback_nothing_is_expected(self):
        journey = travel(13.0, lost("b00002"), {"fusion": {"feedback": False}})
        assert codes(journey.events) == []


class TestTelegrams:
    def test_the_next_balises_id_is_out_of_order_and_the_right_one_missed(self):
        # b00002 says that it is b00003
        undisturbed = travel(11.0)
        passed_s = next(scenario_s(t) for t in undisturbed.truth.values() if t.position_m >= 200.0)
        journey = travel(13.0, lost("b00002"), happening=[telegram("b00003", passed_s)])
        assert codes(journey.events) == ["balise_out_of_order", "balise_missed"]
        assert "before b00002" in next(e.text for e in journey.events)

    def test_an_earlier_balise_is_against_the_travel(self):
        journey = travel(13.0, happening=[telegram("b00001", 12.0)])
        assert codes(journey.events) == ["balise_wrong_direction"]

    def test_a_balise_ten_metres_off_is_early_by_its_distance(self):
        journey = travel(9.0, lost("b00001"), happening=[telegram("b00001", 4.5)])
        assert codes(journey.events) == ["balise_early"]

    def test_a_balise_far_ahead_at_the_beginning_is_unexpected(self):
        journey = travel(4.0, happening=[telegram("b00007", 2.0)])
        assert codes(journey.events) == ["balise_unexpected"]

    def test_a_repeated_balise_of_a_moving_train_is_told(self):
        undisturbed = travel(11.0)
        passed_s = next(scenario_s(t) for t in undisturbed.truth.values() if t.position_m >= 200.0)
        journey = travel(11.0, happening=[telegram("b00002", passed_s + 0.02)])
        assert codes(journey.events) == ["balise_repeated"]

    def test_an_unknown_balise_is_told_as_before(self):
        journey = travel(9.0, happening=[telegram("nobody-knows", 7.0)])
        assert codes(journey.events) == ["unknown_balise"]


class TestStopsAndTurns:
    def test_a_train_that_stands_on_a_balise_may_read_it_again(self):
        stops = {"world": {"motion": {"profile": [[0.0, 20.0], [1.0, 20.0], [9.0, 0.0], [16.0, 0.0], [24.0, 20.0]]}}}
        change = {**stops, "motion_model": {"jerk_psd_m2ps5": 0.1}}
        before = travel(16.0, change=change)
        line = replace(before.train.line, balises=(Balise("b00002", before.truth[at(12.0)].position_m, 0.05),))
        again = [telegram("b00002", t_s, k) for k, t_s in enumerate((10.5, 12.0, 14.0))]
        events, fixes = linked(before.train, line, 27.0, again, reader=False)
        assert codes(events) == []
        assert [f.doubtful for f in fixes] == [None] * len(fixes)
        assert len(fixes) == 3

    def test_a_train_that_turns_round_reads_its_balises_again(self):
        turns = {"world": {"motion": {"profile": [[0.0, 20.0], [7.0, 20.0], [17.0, -20.0], [30.0, -20.0]]}}}
        # 4 m/s² at once: with a smoother motion model the bank would refute the sensors, not the model
        change = {**turns, "motion_model": {"jerk_psd_m2ps5": 0.1}}
        before = travel(24.0, change=change)
        back_s = next(scenario_s(t) for ns, t in sorted(before.truth.items()) if ns > at(13.0) and t.position_m <= 100.0)
        silent_way = codes(before.events)
        journey = travel(24.0, change=change, happening=[telegram("b00001", back_s)])
        # the simulated reader reads forwards only: on its way back the train misses what nobody reads to it
        assert "balise_missed" in silent_way
        assert codes(journey.events) == []


def listener() -> tuple[list[Event], list[AbsoluteFix], Tap]:
    """The events and fixes that a tap collects, and the tap."""
    events: list[Event] = []
    fixes: list[AbsoluteFix] = []

    def tap(output: Output, now_ns: int) -> None:
        if isinstance(output.message, Event):
            events.append(output.message)
        elif isinstance(output.message, AbsoluteFix):
            fixes.append(output.message)

    return events, fixes, tap


def linked(
    train: Train, line: Line, until_s: float, happening: Iterable[tuple[float, Output]] = (), *, reader: bool = True
) -> tuple[list[Event], list[AbsoluteFix]]:
    """Run a train, with its own reader or without, whose balise service has another line than its world."""
    setting = Setting("offline", train.world(until_s), OFFLINE_START_NS)
    without = {"balise"} if reader else {"balise", READER}
    nodes = [ROLES[p.role].build(train, p.unit, setting) for p in processes(train) if p.name not in without]
    service = BaliseNode(train.name, "offline", train.balise_readers, line)
    events, fixes, tap = listener()
    run = OfflineRun(train, [*nodes, service], tap)
    for when_s, output in happening:
        run.bus.run_until(at(when_s))
        run.bus.inject(output.stream, output.unit, output.message, at(when_s))
    run.bus.run_until(at(until_s))
    return events, fixes


def misplaced(
    file: Any, balise: str, by_m: float, seed: int, until_s: float, change: dict[str, Any] | None = None
) -> list[Event]:
    """The events that name a balise where the line has one `by_m` too far."""
    train = load_train(file, change, seed)
    moved = (replace(b, position_m=b.position_m + by_m) if b.balise_id == balise else b for b in train.line.balises)
    events, _ = linked(train, replace(train.line, balises=tuple(moved)), until_s)
    return [e for e in events if e.code == "balise_misplaced"]


class TestMisplaced:
    @pytest.mark.parametrize(("by_m", "seed"), [(0.5, 1), (0.5, 2), (-1.0, 3), (-1.0, 4), (3.0, 5), (3.0, 6)])
    def test_the_maglevs_misplaced_balise_is_named_with_its_offset(self, by_m, seed):
        (event,) = misplaced(MAGLEV, "b00004", by_m, seed, 36.0)
        assert event.severity == "error"
        assert "the line has b00004 at" in event.text
        said_m = float(event.text.split(" m, ")[1].split(" ± ")[0]) * (1.0 if "beyond" in event.text else -1.0)
        # both balises may be mapped to 5 cm; σ is some 5 cm
        assert said_m == pytest.approx(by_m, abs=0.25)

    @pytest.mark.slow
    @pytest.mark.parametrize("seed", range(1, 4))
    def test_the_metros_balise_three_metres_off_is_named(self, seed):
        (event,) = misplaced(METRO, "b00002", 3.0, seed, 165.0)
        assert "the line has b00002 at" in event.text

    @pytest.mark.slow
    @pytest.mark.parametrize("by_m", [-1.0, 3.0])
    def test_the_full_trains_misplaced_balise_is_named(self, by_m):
        # 100 m before b00001, at full speed: b00003 comes after 90 s
        there = {"start_m": 900.0, "profile": [[0.0, 24.0], [100.0, 24.0]]}
        change = {"prior": {"position_m": 900.0, "speed_mps": 24.0}, "world": {"motion": there}}
        (event,) = misplaced(FULL, "b00002", by_m, 1, 95.0, change)
        assert "the line has b00002 at" in event.text


# the full train from 300 s of its own profile on: it slides into a station, stands and leaves
STATION: dict[str, Any] = {
    "prior": {"position_m": 6900.0, "speed_mps": 24.0},
    "world": {
        "motion": {"start_m": 6900.0, "profile": [[0.0, 24.0], [30.0, 24.0], [80.0, 0.0], [110.0, 0.0], [170.0, 24.0]]},
        "creep": {"events": [{"from_s": 50.0, "to_s": 54.0, "ratio": -0.4}]},
    },
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "seed", "until_s", "change"),
    # the full train as it is spins its wheels and comes to its first balise after 74 s
    [(file, seed, 90.0, {}) for file in (MAGLEV, METRO) for seed in (1, 2, 3)]
    + [(FULL, 2, 90.0, {}), (FULL, 1, 150.0, STATION)],
    ids=lambda value: getattr(value, "stem", "" if isinstance(value, dict) else str(value)),
)
def test_a_train_without_faults_has_regular_balises_only(file, seed, until_s, change):
    events, fixes, tap = listener()
    simulate(load_train(file, change, seed), until_s, tap)
    assert codes(events) == []
    assert fixes
    assert {fix.doubtful for fix in fixes} == {None}


class TestRules:
    CHANGE: ClassVar[dict[str, Any]] = {"fusion": {"rule": "federated"}}

    def test_the_information_rule_takes_a_doubtful_fix_for_its_bank(self):
        journey = travel(9.0, happening=[telegram("b00003", BETWEEN_S)])
        assert "balise_out_of_order" in codes(journey.events)
        assert journey.fuser.refusals.counts == {}

    def test_the_federated_rule_refuses_a_doubtful_fix_and_counts_it(self):
        journey = travel(9.0, change=self.CHANGE, happening=[telegram("b00003", BETWEEN_S)])
        assert journey.fuser.refusals.counts == {"doubtful": 1}
        (refused,) = [e for e in journey.events if e.code == "refused_doubtful"]
        assert "b00003: balise_out_of_order" in refused.text
        assert journey.live[at(8.0)].position_m == pytest.approx(journey.truth[at(8.0)].position_m, abs=0.5)
