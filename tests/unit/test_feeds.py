"""What machines read: metrics, vehicle positions and GeoJSON are those of the states, healths and events that were heard."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from google.transit import gtfs_realtime_pb2
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.openmetrics.exposition import generate_latest as generate_openmetrics
from prometheus_client.openmetrics.parser import text_string_to_metric_families as read_openmetrics
from prometheus_client.parser import text_string_to_metric_families

from examples import EXAMPLES, T0, head
from milepost.config.line_file import load_line
from milepost.config.line_tracks import LineTracks
from milepost.config.shipped_files import find_file
from milepost.feeds import fleet as bounds
from milepost.feeds.fleet import FORGET_NS, NS_PER_S, STALE_NS, Fleet
from milepost.feeds.histogram import Histogram
from milepost.feeds.metric_table import METRICS
from milepost.feeds.metrics import families
from milepost.feeds.train_geojson import train_geojson
from milepost.feeds.vehicle_positions import vehicle_positions
from milepost.track.track import Track
from milepost_schemas import EVENT_CODES, Event, FusedState, Health

NOW = T0 + 20_000_000
LINE = load_line(find_file(Path("airport-maglev"), "lines"))


def state(epoch: int = 100, **changed: Any) -> FusedState:
    fields = {**EXAMPLES["state"][0].model_dump(), **head("fuser"), "settled": False, "reset": None, "awaiting": []}
    return FusedState.model_validate({**fields, "epoch": epoch, **changed})


def health(process: str = "filter-radar", **changed: Any) -> Health:
    return Health.model_validate({**EXAMPLES["health"][0].model_dump(), **head(process), **changed})


class Exported:
    """What Prometheus would read of a fleet: values by series."""

    def __init__(self, fleet: Fleet, now_ns: int = NOW) -> None:
        registry = CollectorRegistry()
        registry.register(_Collected(fleet, now_ns))
        self.text = generate_latest(registry).decode()
        self.openmetrics = generate_openmetrics(registry).decode()
        found = [sample for family in text_string_to_metric_families(self.text) for sample in family.samples]
        self.series = {(each.name, frozenset(each.labels.items())): each.value for each in found}

    def __call__(self, name: str, **labels: str) -> float | None:
        """A value of train maglev-1; None where there is no such series."""
        return self.series.get((f"milepost_{name}", frozenset({"train": "maglev-1", **labels}.items())))


class _Collected:
    def __init__(self, fleet: Fleet, now_ns: int) -> None:
        self._at = fleet, now_ns

    def collect(self) -> Any:
        return families(*self._at)


def heard(*messages: Any, now_ns: int = NOW) -> Fleet:
    fleet = Fleet()
    for message in messages:
        fleet.receive(message, now_ns)
    return fleet


def test_a_state_is_exported_in_base_units() -> None:
    shown = Exported(heard(state()))
    assert shown("position_meters") == 1234.5
    assert shown("position_interval_width_meters") == 19.75
    assert shown("speed_interval_width_meters_per_second") == 10.5
    assert shown("status", milepost_status="normal") == 1.0
    assert shown("status", milepost_status="lost") == 0.0
    assert shown("unit_share_ratio", unit="radar") == 1.0
    assert shown("unit_age_seconds", unit="radar") == 0.005
    assert shown("unit_excluded", unit="loop", kind="silent") == 1.0
    assert shown("unit_doubted", unit="radar") == 1.0
    assert shown("balise_distance_meters") == 34.5
    assert shown("line_info", line="maglev-test-track", line_hash="0123456789abcdef") == 1.0


def test_latency_and_delivery_are_histograms_of_every_state() -> None:
    # 1 ms from the epoch to the publication, 9 ms from there to here
    shown = Exported(heard(state(100), state(101)))
    assert shown("state_latency_seconds_count") == shown("state_delivery_seconds_count") == 2.0
    assert shown("state_latency_seconds_bucket", le="0.005") == 2.0
    assert shown("state_delivery_seconds_bucket", le="0.005") == 0.0
    assert shown("state_delivery_seconds_bucket", le="0.01") == 2.0
    assert shown("state_delivery_seconds_sum") == pytest.approx(0.018)


def test_a_time_of_delivery_below_zero_is_not_counted() -> None:
    """Scenario time may run faster than the receiver's clock."""
    shown = Exported(heard(state(published_at_ns=NOW + 1)))
    assert shown("state_delivery_seconds_count") == 0.0


def test_missing_epochs_steps_and_incomplete_states_are_counted_and_a_second_state_of_an_epoch_is_not() -> None:
    reset = {"size_m": 0.4, "size_mps": -0.1, "reason": "excluded: radar"}
    shown = Exported(heard(state(100), state(100), state(103, awaiting=["radar"]), state(102), state(104, reset=reset)))
    assert shown("states_total") == 3.0
    assert shown("states_missing_total") == 2.0
    assert shown("states_incomplete_total") == 1.0
    assert shown("state_resets_total") == 1.0


def test_the_epochs_of_a_train_that_was_away_are_not_missing() -> None:
    fleet = heard(state(100))
    fleet.receive(state(100 + 2000), NOW + 40 * NS_PER_S)
    assert Exported(fleet, NOW + 40 * NS_PER_S)("states_missing_total") == 0.0


def test_no_series_is_there_twice_whatever_is_sent() -> None:
    """Prometheus refuses the whole scrape otherwise."""
    long = "a" * 200
    odd = {f"{long}1": 1, f"{long}2": 2, 'quote " and \n end': 3, "": 4, "duplicate": 5}
    sensors = [{"unit": "radar", "share": 0.5, "age_s": 0.0}] * 3
    excluded = [{"unit": "radar", "reason": "silent", "kind": kind} for kind in ("silent", "late", None)]
    fleet = heard(state(sensors=sensors, excluded=excluded, doubted=["radar", "radar"]), health(refused=odd))
    fleet.alive("maglev-1", "filter-radar", "a1b2c3d4", True, NOW)
    text = Exported(fleet).text
    series = [line.rpartition(" ")[0] for line in text.splitlines() if not line.startswith("#")]
    assert len(set(series)) == len(series)
    assert Exported(fleet)("process_refused_total", process="filter-radar", reason='quote " and \n end') == 3.0


def test_a_unit_that_goes_out_of_use_is_counted_each_time() -> None:
    left_out = [{"unit": "loop", "reason": "silent", "kind": "silent"}]
    fleet = heard(*(state(100 + i, excluded=left_out if i % 2 else []) for i in range(6)))
    assert Exported(fleet)("unit_exclusions_total", unit="loop") == 3.0


def test_a_health_is_exported_by_process_stream_and_reason() -> None:
    fleet = heard(health())
    fleet.alive("maglev-1", "filter-radar", "a1b2c3d4", True, NOW)
    shown = Exported(fleet)
    assert shown("process_received_hertz", process="filter-radar", stream="speed_reading") == 100.0
    assert shown("process_refused_total", process="filter-radar", reason="duplicate") == 2.0
    assert shown("process_rewinds_total", process="filter-radar") == 3.0
    assert shown("process_step_seconds", process="filter-radar", quantile="1") == pytest.approx(300.25e-6)
    assert shown("process_delivery_seconds", process="filter-radar", quantile="0.99") == pytest.approx(1.5e-3)
    assert shown("process_uptime_seconds", process="filter-radar") == 12.5


def test_a_process_that_ends_disappears_and_its_successor_is_a_restart() -> None:
    fleet = heard(health())
    for instance, there in (("a1b2c3d4", True), ("a1b2c3d4", False)):
        fleet.alive("maglev-1", "filter-radar", instance, there, NOW)
    assert "filter-radar" not in Exported(fleet).text
    fleet.alive("maglev-1", "filter-radar", "b2", True, NOW)
    fleet.receive(health(instance="b2"), NOW)
    shown = Exported(fleet)
    assert shown("process_restarts_total", process="filter-radar") == 1.0
    assert shown("process_instances", process="filter-radar") == 1.0


def test_a_token_that_comes_back_after_an_outage_of_the_router_is_no_restart() -> None:
    fleet = Fleet()
    for there in (True, False, True):
        fleet.alive("maglev-1", "fuser", "a1", there, NOW)
    assert Exported(fleet)("process_restarts_total", process="fuser") == 0.0


def test_a_unit_that_is_no_longer_in_the_state_disappears() -> None:
    assert 'unit="loop"' not in Exported(heard(state(100), state(101, excluded=[]))).text


def test_an_old_state_is_exported_no_more_but_when_it_came_is() -> None:
    shown = Exported(heard(state()), NOW + STALE_NS + 1)
    assert shown("position_meters") is None
    assert shown("state_received_timestamp_seconds") == pytest.approx(NOW / NS_PER_S)


def test_a_train_that_was_silent_for_long_is_forgotten() -> None:
    fleet = heard(state(), health())
    fleet.forget(NOW + FORGET_NS)
    assert "maglev-1" in fleet.trains
    fleet.forget(NOW + FORGET_NS + 1)
    assert not fleet.trains


def test_several_trains_are_told_apart_by_label() -> None:
    shown = Exported(heard(state(), state(train="full-1", position_m=1240.0)))
    assert shown("position_meters") == 1234.5
    assert shown("position_meters", train="full-1") == 1240.0


def test_events_are_counted_by_their_row_from_zero_on() -> None:
    event = {**head("fuser"), "severity": "warning", "text": "."}
    codes = ("unit_silent", "unit_silent", "refused_duplicate", "invented_by_a_stranger")
    shown = Exported(heard(*(Event(**event, code=code) for code in codes)))
    assert shown("events_total", code="unit_silent", severity="warning") == 2.0
    assert shown("events_total", code="refused_REASON", severity="warning") == 1.0
    assert shown("events_total", code="unknown", severity="unknown") == 1.0
    assert all(shown("events_total", code=row.code, severity=row.severity) is not None for row in EVENT_CODES)


def test_strangers_cannot_make_the_export_grow_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "MOST_TRAINS", 3)
    monkeypatch.setattr(bounds, "MOST_PROCESSES", 4)
    fleet = Fleet()
    for i in range(20):
        fleet.receive(state(train=f"train-{i}"), NOW)
        fleet.alive("train-0", f"unit-{i}", "a1", True, NOW)
        fleet.alive("train-0", "unit-0", f"instance-{i}", True, NOW)
    fleet.receive(health("unit-0", train="train-0", received_hz={f"s{i}": 1.0 for i in range(999)}), NOW)
    fleet.receive(health("unit-0", train="train-0", refused={f"reason {i}": 1 for i in range(999)}), NOW)
    assert len(fleet.trains) == 3
    assert len(fleet.trains["train-0"].processes) == 4
    assert len(fleet.trains["train-0"].processes["unit-0"].instances) == bounds.MOST_INSTANCES
    shown = Exported(fleet)
    assert shown.series["milepost_feed_left_out_total", frozenset()] == 17 + 16
    assert len(shown.series) < 600


def test_names_and_units_are_those_that_prometheus_asks_for() -> None:
    for row in METRICS:
        assert row.name.startswith("milepost_")
        assert not row.name.endswith(("_total", "_info", "_count", "_sum", "_bucket"))
        assert not {"ms", "us", "kmh", "percent", "mps"} & set(row.name.split("_")), "base units only"
        assert row.help.endswith(".")
    assert len({row.name for row in METRICS}) == len(METRICS)


def test_the_export_is_valid_openmetrics_too() -> None:
    fleet = heard(state(), health())
    fleet.alive("maglev-1", "filter-radar", "a1b2c3d4", True, NOW)
    read = {family.name for family in read_openmetrics(Exported(fleet).openmetrics)}
    assert read == {row.name for row in METRICS}


def test_a_histogram_counts_bounds_in() -> None:
    histogram = Histogram((0.1, 0.2))
    for value in (0.1, 0.15, 0.2, 5.0):
        histogram.observe(value)
    assert list(histogram.buckets()) == [("0.1", 1.0), ("0.2", 3.0), ("+Inf", 4.0)]


def read_positions(*states: FusedState) -> Any:
    feed = gtfs_realtime_pb2.FeedMessage()
    feed.ParseFromString(vehicle_positions(states, NOW))
    return feed


def test_vehicle_positions_are_a_full_dataset_of_all_trains() -> None:
    feed = read_positions(state(), state(train="full-1", speed_mps=-20.0, speed_min_mps=-21.0))
    assert feed.IsInitialized()
    assert feed.header.gtfs_realtime_version == "2.0"
    assert feed.header.incrementality == gtfs_realtime_pb2.FeedHeader.FULL_DATASET
    assert feed.header.timestamp == NOW // NS_PER_S
    assert [entity.id for entity in feed.entity] == ["maglev-1", "full-1"]
    first, second = (entity.vehicle for entity in feed.entity)
    assert (first.position.latitude, first.position.longitude) == (50.5, 4.25)
    assert first.position.speed == 20.25
    assert second.position.speed == 20.0
    assert first.timestamp == state().measured_at_ns // NS_PER_S
    # the state has no heading, no distance run and no stop
    for field in ("bearing", "odometer"):
        assert not first.position.HasField(field)
    assert not first.HasField("trip")


@pytest.mark.parametrize("changed", [{"latitude_deg": None}, {"status": "lost"}, {"status": "initialising"}])
def test_a_train_whose_place_is_not_known_is_not_in_the_feed(changed: dict[str, Any]) -> None:
    assert not read_positions(state(**changed)).entity


def on_line(**changed: Any) -> FusedState:
    latitude, longitude = LINE.track.locate(5000.0)
    place = {"latitude_deg": latitude, "longitude_deg": longitude, "position_m": 5000.0}
    return state(line=LINE.name, line_hash=LINE.content_hash, position_min_m=4800.0, position_max_m=5300.0, **place, **changed)


def tracks(name: str, content_hash: str) -> Track | None:
    return LINE.track if (name, content_hash) == (LINE.name, LINE.content_hash) else None


def check_rfc_7946(collection: Any) -> None:
    assert set(collection) == {"type", "features"}
    assert collection["type"] == "FeatureCollection"
    for feature in collection["features"]:
        assert set(feature) == {"type", "id", "geometry", "properties"}
        assert feature["type"] == "Feature"
        assert isinstance(feature["id"], str)
        assert isinstance(feature["properties"], dict)
        geometry = feature["geometry"]
        if geometry is None:
            continue
        positions = [geometry["coordinates"]] if geometry["type"] == "Point" else geometry["coordinates"]
        assert geometry["type"] in ("Point", "LineString")
        assert geometry["type"] == "Point" or len(positions) >= 2
        for longitude, latitude in positions:
            assert -180.0 <= longitude <= 180.0
            assert -90.0 <= latitude <= 90.0


def test_a_train_is_a_point_and_its_interval_a_line_in_geojson() -> None:
    found = json.loads(json.dumps(train_geojson([on_line()], tracks), allow_nan=False))
    check_rfc_7946(found)
    point, interval = found["features"]
    latitude, longitude = LINE.track.locate(5000.0)
    assert point["geometry"]["coordinates"] == [round(longitude, 7), round(latitude, 7)]
    assert point["properties"]["position_m"] == 5000.0
    assert point["properties"]["speed_mps"] == 20.25
    assert point["properties"]["measured_at"] == "2023-11-14T22:13:20.010+00:00"
    ends = interval["geometry"]["coordinates"][0], interval["geometry"]["coordinates"][-1]
    for (x, y), at_m in zip(ends, (4800.0, 5300.0), strict=True):
        assert LINE.track.project(y, x).position_m == pytest.approx(at_m, abs=0.02)
    assert interval["properties"] == {
        "feature": "interval", "train": "maglev-1", "position_min_m": 4800.0, "position_max_m": 5300.0
    }  # fmt: skip


def test_a_train_on_a_line_without_geometry_has_no_place() -> None:
    found = train_geojson([state(latitude_deg=None, longitude_deg=None)], tracks)
    check_rfc_7946(found)
    (feature,) = found["features"]
    assert feature["geometry"] is None
    assert feature["properties"]["position_min_m"] == 1224.25


def test_an_interval_follows_the_line_and_ends_with_it() -> None:
    whole = LINE.track.stretch(-50.0, LINE.track.length_m + 50.0)
    at_m = [LINE.track.project(*place).position_m for place in whole]
    assert at_m == sorted(at_m)
    assert at_m[0] == pytest.approx(0.0, abs=0.02)
    assert at_m[-1] == pytest.approx(LINE.track.length_m, abs=0.02)
    assert LINE.track.stretch(-20.0, -10.0) == []
    assert len(LINE.track.stretch(1000.0, 1000.5)) == 2
    middle = [LINE.track.project(*place) for place in LINE.track.stretch(900.0, 3000.0)]
    assert max(abs(each.cross_track_m) for each in middle) < 0.02


def test_the_geometry_of_a_line_is_found_by_name_and_used_only_if_it_is_the_same_line() -> None:
    said: list[str] = []
    known = LineTracks(tell=said.append)
    track = known(LINE.name, LINE.content_hash)
    assert track is not None
    assert math.isclose(track.length_m, LINE.track.length_m)
    assert known("metro", load_line(find_file(Path("metro"), "lines")).content_hash) is None
    assert not said
    for name in (LINE.name, "nowhere", "nowhere"):
        assert known(name, "0" * 16) is None
    assert len(said) == 2


def test_a_name_from_the_network_opens_no_other_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.yaml").write_text("password: 1", encoding="utf-8")
    (tmp_path / "secret").write_text("password: 1", encoding="utf-8")
    for name in ("secret.yaml", "secret", "..", "maglev.yaml"):
        said: list[str] = []
        assert LineTracks(tell=said.append)(name, "0" * 16) is None
        assert said == [f"no geometry of line {name} ({'0' * 16}): no line file in deploy/lines or --line is this line"]
