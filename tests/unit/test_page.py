"""The dispatch page without a browser: what is shown of what was heard, and how little is sent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from examples import EXAMPLES, T0, head
from milepost.config.line_file import load_line
from milepost.config.line_tracks import KnownLines
from milepost.config.shipped_files import find_file
from milepost.feeds.fleet import FORGET_NS, MOST_TRAINS, NS_PER_S
from milepost.page.drawing import MOST_POINTS, drawing_of
from milepost.page.heard import KEPT_EVENTS, KEPT_INFOS, KEPT_POINTS, Heard
from milepost.page.injecting import faults_for, options_of, units_of, words_of
from milepost.page.overview import FLEET
from milepost.page.possible import condition
from milepost.page.rows import Sent
from milepost.page.viewer import Viewer
from milepost.page.words import STATUSES, age, figure, meaning_of
from milepost_schemas import Event, FusedState, Health, Hypotheses, Truth, encode
from milepost_schemas.state import Status

NOW = T0 + 20_000_000
TRAIN = "maglev-1"
LINE = load_line(find_file(Path("airport-maglev"), "lines"))


def state(epoch: int = 100, **changed: Any) -> FusedState:
    fields = {**EXAMPLES["state"][0].model_dump(), **head("fuser"), "settled": False, "reset": None, "awaiting": []}
    fields |= {"doubted": [], "excluded": [], "status": "normal"}
    return FusedState.model_validate({**fields, "epoch": epoch, **changed})


def event(code: str = "unit_excluded", severity: str = "warning", **changed: Any) -> Event:
    return Event.model_validate({**head("fuser"), "code": code, "severity": severity, "text": "radar: biased", **changed})


def heard(*messages: Any, at_ns: int = NOW) -> Heard:
    found = Heard()
    for message in messages:
        tell(found, message, at_ns)
    return found


def tell(found: Heard, message: Any, at_ns: int = NOW) -> None:
    found.receive(message.SCHEMA, message.train, message.unit, encode(message), at_ns)
    found.refresh()


def no_line(name: str, content_hash: str) -> None:
    return None


def rows(found: Heard, train: str = "", now_ns: int = NOW) -> dict[str, Any]:
    return Viewer(found, no_line, train).frame(now_ns)["set"]


def test_a_row_has_the_status_in_words_and_figures_in_everyday_units() -> None:
    row = rows(heard(state(position_m=1234.56, speed_mps=20.0)))[TRAIN]
    assert (row["word"], row["level"], row["position"], row["speed"]) == ("normal", "ok", "1234.6", "72.0")
    assert (row["width"], row["age"], row["line"], row["note"]) == ("19.8", "< 1 s", "maglev-test-track", "")


def test_every_status_has_words_of_its_own() -> None:
    assert set(Status.__args__) < set(STATUSES)
    assert len({words.word for words in STATUSES.values()}) == len(STATUSES)


def test_a_silent_train_says_so_with_its_age_growing_and_no_figure_that_looks_fresh() -> None:
    found = heard(state())
    for seconds, shown in ((1.5, "2 s"), (30.0, "30 s"), (300.0, "5 min")):
        now_ns = NOW + round(seconds * NS_PER_S)
        row = rows(found, now_ns=now_ns)[TRAIN]
        assert (row["word"], row["age"]) == ("silent", shown)
        assert {row["position"], row["speed"], row["width"]} == {"unknown"}
        top = rows(found, TRAIN, now_ns)["head"]
        assert {top["position"], top["speed_bounds"], top["accuracy"], top["place"], top["excluded"]} == {"unknown"}
        assert top["last_known"] == f"last known 1234.5 m, {shown} ago"
        units = [fields for name, fields in rows(found, TRAIN, now_ns).items() if name.startswith("unit/")]
        assert {(each["judgement"], each["age"], each["rate"]) for each in units} == {("unknown", "unknown", "unknown")}


def test_a_train_whose_processes_have_all_ended_is_ended_and_not_only_silent() -> None:
    found = heard(state())
    found.alive(TRAIN, "fuser", "a1", True, NOW)
    later = NOW + 2 * NS_PER_S
    assert rows(found, now_ns=later)[TRAIN]["word"] == "silent"
    found.alive(TRAIN, "fuser", "a1", False, later)
    assert rows(found, now_ns=later)[TRAIN]["word"] == "ended"


def test_a_train_that_is_only_starting_is_shown_without_figures() -> None:
    found = Heard()
    found.alive(TRAIN, "fuser", "a1", True, NOW)
    row = rows(found)[TRAIN]
    assert (row["word"], row["position"], row["age"]) == ("unknown", "unknown", "unknown")
    assert rows(found, "nobody-1")["head"]["word"] == "unknown"


def test_the_fleet_is_summed_up_in_words() -> None:
    found = heard(state(), state(train="metro-1", status="lost"), state(train="metro-2"))
    assert rows(found)[FLEET]["summary"] == "3 trains: 2 normal, 1 lost"


def test_an_excluded_unit_is_named_with_its_judgement_and_the_reason() -> None:
    out = [
        {"unit": "loop", "reason": "0.4 m/s off", "kind": "out_of_range"},
        {"unit": "gnss", "reason": "not heard", "kind": "silent"},
    ]
    found = heard(state(status="degraded", excluded=out))
    shown = rows(found, TRAIN)
    loop = shown["unit/loop"]
    assert (loop["judgement"], loop["detail"], loop["level"], loop["share"]) == (
        "excluded: out of range",
        "0.4 m/s off",
        "bad",
        None,
    )
    assert shown["unit/gnss"]["level"] == "warn"
    assert shown["head"]["excluded"] == "loop: out of range; gnss: silent"
    assert rows(found)[TRAIN]["note"] == "loop out of range; gnss silent"


def test_units_that_contradict_each_other_are_doubted() -> None:
    shown = rows(heard(state(doubted=["radar", "loop"])), TRAIN)
    assert (shown["unit/radar"]["judgement"], shown["unit/radar"]["detail"]) == ("doubted", "contradicts loop")
    assert shown["head"]["doubted"] == "radar and loop contradict each other"


def hypotheses(*found: dict[str, Any], **changed: Any) -> Hypotheses:
    whole = [{"position_std_m": 0.25, "speed_std_mps": 0.1, **each} for each in found]
    return Hypotheses.model_validate({**head("fuser"), "epoch": 100, "hypotheses": whole, **changed})


def test_each_hypothesis_is_a_question_and_how_far_off_the_train_then_is() -> None:
    told = hypotheses(
        {"without": [], "judgement": "refuted", "position_m": 1236.5, "speed_mps": 21.0},
        {"without": ["radar"], "judgement": "leads", "position_m": 1234.5, "speed_mps": 20.0},
        {"without": ["loop", "radar"], "judgement": "held", "position_m": 1234.0, "speed_mps": 20.0},
        {"without": ["motion-model", "radar"], "judgement": "unlikely", "position_m": 1234.5, "speed_mps": 19.0},
    )
    shown = rows(heard(state(), told), TRAIN)
    assert [list(shown[f"hypothesis/{place:03}"].values()) for place in range(4)] == [
        ["nobody lies", "refuted", "bad", "+2.00 ± 0.25\u00a0m", "+3.60 ± 0.36\u00a0km/h"],
        ["radar lies", "published", "ok", "0.00 ± 0.25\u00a0m", "0.00 ± 0.36\u00a0km/h"],
        ["loop and radar lie", "possible", "info", "-0.50 ± 0.25\u00a0m", "0.00 ± 0.36\u00a0km/h"],
        [
            "radar lies, and the train moves harder than its file says",
            "unlikely",
            "idle",
            "0.00 ± 0.25\u00a0m",
            "-3.60 ± 0.36\u00a0km/h",
        ],
    ]


def test_a_condition_is_a_sentence() -> None:
    assert condition(["a", "b", "c"]) == "a, b and c lie"
    assert condition(["motion-model"]) == "the train moves harder than its file says"


def test_hypotheses_that_are_not_of_the_states_time_are_not_shown() -> None:
    one = {"without": [], "judgement": "leads", "position_m": 1234.5, "speed_mps": 20.0}
    old = hypotheses(one, measured_at_ns=head()["measured_at_ns"] - 4 * NS_PER_S)
    assert not any(name.startswith("hypothesis/") for name in rows(heard(state(), old), TRAIN))
    silent = rows(heard(state(), hypotheses(one)), TRAIN, NOW + 2 * NS_PER_S)
    assert not any(name.startswith("hypothesis/") for name in silent)


def test_a_rate_is_that_of_the_units_readings_beside_the_expected_one_where_it_is_slow() -> None:
    fields = {**EXAMPLES["health"][0].model_dump(), **head("filter-radar")}
    fields |= {"received_hz": {"speed_reading": 40.0, "feedback": 50.0}, "expected_hz": {"speed_reading": 100.0}}
    shown = rows(heard(state(), Health.model_validate(fields)), TRAIN)["unit/radar"]
    assert (shown["rate"], shown["share"], shown["age"]) == ("40 of 100 Hz", 1.0, "5 ms")


@pytest.mark.parametrize(
    ("true_m", "error", "level"),
    [
        (1234.0, "+0.50 m, inside the protected interval", "ok"),
        (1300.0, "-65.50 m, OUTSIDE the protected interval", "bad"),
    ],
)
def test_the_true_error_is_that_of_the_truth_carried_over_to_the_states_time(true_m: float, error: str, level: str) -> None:
    early = {**head("world"), "measured_at_ns": head()["measured_at_ns"] - 100_000_000}
    truth = Truth.model_validate({**early, "position_m": true_m - 2.0, "speed_mps": 20.0, "acceleration_mps2": 0.0})
    top = rows(heard(state(), truth), TRAIN)["head"]
    assert (top["error"], top["error_level"], top["true_m"]) == (error, level, true_m)
    assert rows(heard(state()), TRAIN)["head"]["error"] == ""


def test_events_say_what_to_do_and_infos_do_not_push_out_warnings() -> None:
    found = heard(event(), *(event("wheel_diameter", "info") for _ in range(3 * KEPT_EVENTS)))
    shown = {name: fields for name, fields in rows(found, TRAIN).items() if name.startswith("event/")}
    assert len(shown) == 1 + KEPT_INFOS
    first = shown["event/0"]
    assert (first["severity"], first["text"], first["what"]) == ("warning", "radar: biased", "unit excluded")
    assert first["action"] == meaning_of("unit_excluded").action  # type: ignore[union-attr]
    assert meaning_of("refused_flood") == meaning_of("refused_stale")


def test_only_what_is_different_is_sent() -> None:
    found = heard(state())
    viewer = Viewer(found, no_line, TRAIN)
    assert "position_bounds" in viewer.frame(NOW)["set"]["head"]
    assert viewer.frame(NOW) == {"set": {}, "gone": []}
    tell(found, state(101, position_m=1235.0))
    change = viewer.frame(NOW)
    assert set(change["set"]["head"]) == {"position", "at_m"}
    assert len(change["set"]) == 1


def test_rows_that_go_are_named() -> None:
    sent = Sent()
    sent.change({"a": {"x": 1.0}, "b": {"x": None}})
    assert sent.change({"b": {"x": 2.0, "y": None}}) == ({"b": {"x": 2.0, "y": None}}, ["a"])


def test_points_of_the_speed_are_sent_once_and_all_again_where_the_train_began_again() -> None:
    found = heard()
    viewer = Viewer(found, no_line, TRAIN)
    for i in range(20):
        tell(found, state(100 + i, measured_at_ns=T0 + i * NS_PER_S // 4))
        if i == 9:
            assert [each[0] for each in viewer.frame(NOW)["points"]] == [0.0, 0.5, 1.0, 1.5, 2.0]
    frame = viewer.frame(NOW)
    assert [each[0] for each in frame["points"]] == [2.5, 3.0, 3.5, 4.0, 4.5]
    assert not frame["again"]
    tell(found, state(1, measured_at_ns=T0 - NS_PER_S), NOW + 5 * NS_PER_S)
    frame = viewer.frame(NOW)
    assert ([each[0] for each in frame["points"]], frame["again"]) == ([0.0], True)


def test_a_second_state_of_an_epoch_and_settled_states_change_nothing() -> None:
    found = heard(state(100), state(100, position_m=1240.0), state(99, position_m=1240.0), state(101, settled=True))
    assert rows(found)[TRAIN]["position"] == "1234.5"


def test_memory_is_bounded_whatever_is_sent() -> None:
    found = Heard()
    for i in range(MOST_TRAINS + 5):
        found.receive("event", f"t{i}", "fuser", b"\xc1", NOW)
    assert len(found.trains()) == MOST_TRAINS
    assert "too many" in rows(found)[FLEET]["left_out"]
    one = found.trains()[0]
    for i in range(3 * KEPT_POINTS):
        tell(found, state(100 + i, train=one.name, measured_at_ns=T0 + i * NS_PER_S, published_at_ns=T0 + i * NS_PER_S))
        found.receive("health", one.name, f"process-{i}", b"\xc1", NOW)
    assert len(one.points) == KEPT_POINTS
    assert len(one.raw_healths) <= MOST_TRAINS
    found.forget(NOW + FORGET_NS + 1)
    assert found.trains() == []


def test_garbage_and_messages_in_another_trains_name_are_not_shown() -> None:
    found = heard(state())
    found.receive("state", TRAIN, "state", b"\xc1garbage", NOW)
    found.receive("state", TRAIN, "state", encode(state(200, train="metro-1", position_m=1240.0)), NOW)
    assert rows(found)[TRAIN]["position"] == "1234.5"


def test_a_line_is_drawn_with_its_balises_tunnels_and_track_and_sent_once() -> None:
    drawing = drawing_of(LINE)
    assert (len(drawing["balises"]), drawing["tunnels"]) == (18, [[6700.0, 7100.0], [12100.0, 13000.0]])
    assert drawing["stations"] == [["Airport", 250.0], ["Exhibition Centre", 9800.0], ["City", 18300.0]]
    track = drawing["track"]
    assert len(track) == MOST_POINTS
    (s0, e0, n0), (s1, e1, n1) = track[100], track[101]
    assert ((e1 - e0) ** 2 + (n1 - n0) ** 2) ** 0.5 == pytest.approx(s1 - s0, rel=0.01)
    found = heard(state(line=LINE.name, line_hash=LINE.content_hash))
    viewer = Viewer(found, KnownLines(), TRAIN)
    assert viewer.frame(NOW)["line"]["length_m"] == pytest.approx(LINE.length_m, abs=0.1)
    assert "line" not in viewer.frame(NOW)
    assert Viewer(found, no_line, TRAIN).frame(NOW)["line"] is None


def test_a_line_without_geometry_has_a_schematic_alone() -> None:
    metro = drawing_of(load_line(find_file(Path("metro"), "lines")))
    assert (metro["track"], metro["length_m"], metro["balise_count"]) == ([], 12000.0, 12)


@pytest.mark.parametrize(("value", "shown"), [(-0.001, "0.00"), (-0.02, "-0.02"), (3.0, "3.00"), (None, "unknown")])
def test_figures(value: float | None, shown: str) -> None:
    assert figure(value, 2) == shown


def test_ages_are_in_one_unit() -> None:
    assert [age(each) for each in (0.3, 5.2, 119.0, 150.0, 8000.0, None)] == [
        "< 1 s",
        "5 s",
        "119 s",
        "2 min",
        "2 h",
        "unknown",
    ]


def test_faults_that_are_offered_fit_what_the_sensor_sends_and_their_options_become_words() -> None:
    fields = {**EXAMPLES["health"][0].model_dump(), **head("sensor-gnss"), "sent_hz": {"position_reading": 5.0}}
    offered = faults_for(Health.model_validate({**fields, "expected_hz": {}}))
    assert "false_rtk" in offered
    assert "spin" not in offered
    assert "spin" in faults_for(None)
    (size,) = options_of("bias")
    assert (size.name, size.kind, size.required) == ("size", "number", True)
    assert words_of([size], {"size": -1.5}) == ["--size=-1.5"]
    (*_, once) = [each for each in options_of("wrong_balise") if each.kind == "flag"]
    assert words_of([once], {once.name: False}) == [f"--no-{once.name}"]


def test_units_are_those_whose_sensors_live() -> None:
    found = Heard()
    for process in ("sensor-radar", "sensor-gnss", "fuser", "filter-radar"):
        found.alive(TRAIN, process, "a1", True, NOW)
    found.alive(TRAIN, "sensor-gnss", "a1", False, NOW)
    assert units_of(found.trains()[0]) == ["radar"]
