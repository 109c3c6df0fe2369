"""The web server beside a real train: what Prometheus, a GTFS-Realtime reader and a map would get."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from google.transit import gtfs_realtime_pb2
from prometheus_client.openmetrics.parser import text_string_to_metric_families as read_openmetrics
from prometheus_client.parser import text_string_to_metric_families

from conftest import free_port, running, width_m
from milepost.config.line_file import load_line
from milepost.config.shipped_files import find_file
from milepost.feeds.metric_table import BY_NAME

OPENMETRICS = {"Accept": "application/openmetrics-text; version=1.0.0"}


class Answer(NamedTuple):
    """What a server said."""

    status: int
    kind: str
    content: bytes


def get(port: int, path: str, method: str = "GET", headers: dict[str, str] | None = None) -> Answer:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5.0)
    try:
        connection.request(method, path, headers=headers or {})
        answer = connection.getresponse()
        return Answer(answer.status, answer.headers["Content-Type"], answer.read())
    finally:
        connection.close()


def scrape(port: int) -> dict[tuple[str, ...], float]:
    """Values by name and labels' values in the order of their names."""
    families = text_string_to_metric_families(get(port, "/metrics").content.decode())
    return {(s.name, *(s.labels[label] for label in sorted(s.labels))): s.value for family in families for s in family.samples}


def soon(what: Callable[[], Any], timeout_s: float, why: str) -> Any:
    """What `what()` returns once it is true; asked five times a second, as often as a person would look."""
    deadline = time.monotonic() + timeout_s
    while not (found := what()):
        assert time.monotonic() < deadline, f"not within {timeout_s:g} s: {why}"
        time.sleep(0.2)
    return found


@pytest.fixture(scope="module")
def train() -> Iterator[tuple[Any, Any, int]]:
    """The default train with a web server; yields both and the port."""
    port = free_port()
    with running("full", "milepost/v1/full-1/state", "--feed", str(port)) as (stack, outside):
        soon(lambda: ("milepost_states_total", "full-1") in scrape(port), 10.0, "a state in the metrics")
        yield stack, outside, port


def test_a_scrape_has_the_state_the_units_and_the_processes_of_a_running_train(train):
    _, outside, port = train
    found = soon(
        lambda: (s := scrape(port)).get(("milepost_process_sent_hertz", "fuser", "state", "full-1")) and s, 10.0, "rates"
    )
    newest = outside.newest("milepost/v1/full-1/state")
    assert found["milepost_status", "normal", "full-1"] == 1.0
    assert found["milepost_position_meters", "full-1"] == pytest.approx(newest["position_m"], abs=30.0)
    assert found["milepost_position_interval_width_meters", "full-1"] == pytest.approx(width_m(newest), rel=0.5)
    units = {labels[-1] for name, *labels in found if name == "milepost_unit_share_ratio"}
    assert units == {each["unit"] for each in newest["sensors"]}
    processes = {labels[0] for name, *labels in found if name == "milepost_process_uptime_seconds"}
    assert {"fuser", "fuser-2", "world", "balise", "sensor-gnss", "filter-imu"} <= processes
    assert (
        found["milepost_process_sent_hertz", "fuser", "state", "full-1"]
        + found.get(("milepost_process_sent_hertz", "fuser-2", "state", "full-1"), 0.0)
        > 40.0
    )
    assert found["milepost_process_expected_hertz", "sensor-imu", "inertial_reading", "full-1"] == 20.0
    assert found["milepost_state_latency_seconds_count", "full-1"] > 20.0
    assert found["milepost_state_latency_seconds_bucket", "+Inf", "full-1"] == found["milepost_states_total", "full-1"]


def test_every_exported_name_is_in_the_table_and_openmetrics_says_the_same(train):
    _, _, port = train
    answer = get(port, "/metrics", headers=OPENMETRICS)
    assert answer.kind.startswith("application/openmetrics-text")
    assert {family.name for family in read_openmetrics(answer.content.decode())} == set(BY_NAME)


def test_the_number_of_series_stays_the_same_from_scrape_to_scrape(train):
    _, outside, port = train
    first = set(scrape(port))
    assert len(first) < 700
    begun = len(outside.messages("milepost/v1/full-1/health/fuser"))
    outside.wait_for(lambda: len(outside.messages("milepost/v1/full-1/health/fuser")) >= begun + 3, 10.0, "three seconds")
    new = {each[0] for each in set(scrape(port)) - first}
    # a unit may be excluded, a first reason may refuse, a balise may be read, the first message of who hears it
    may_come = (
        "balise_distance_meters",
        "unit_excluded",
        "process_refused_total",
        "process_sent_hertz",
        "process_received_hertz",
        "process_delivery_seconds",
    )
    assert new <= {f"milepost_{name}" for name in may_come}


def test_a_killed_process_disappears_and_comes_back_as_a_restart(train):
    """GIVEN a train, WHEN a sensor's process is killed, THEN its unit is excluded, counted, and its process restarted."""
    stack, _, port = train
    restarts = ("milepost_process_restarts_total", "sensor-radar-rear", "full-1")
    before = scrape(port)
    os.kill(stack.pid_of("sensor", "radar-rear"), signal.SIGKILL)
    soon(lambda: scrape(port).get(restarts) == before[restarts] + 1.0, 15.0, "a restart in the metrics")
    after = soon(lambda: (s := scrape(port))["milepost_status", "normal", "full-1"] == 1.0 and s, 30.0, "a normal train")
    exclusions = ("milepost_unit_exclusions_total", "full-1", "radar-rear")
    assert after[exclusions] >= before[exclusions] + 1.0
    code = ("milepost_events_total", "unit_absent", "warning", "full-1")
    assert after[code] >= before[code] + 1.0
    assert after["milepost_process_instances", "sensor-radar-rear", "full-1"] == 1.0


def test_refused_messages_are_counted_by_reason(train):
    _, outside, port = train
    outside.session.put("milepost/v1/full-1/reading/radar-rear", b"\xc1garbage")
    key = ("milepost_process_refused_total", "filter-radar-rear", "undecodable", "full-1")
    assert soon(lambda: scrape(port).get(key), 10.0, "a refusal in the metrics") == 1.0


def test_vehicle_positions_are_read_by_the_official_bindings(train):
    _, outside, port = train
    answer = get(port, "/vehicle-positions.pb")
    assert (answer.status, answer.kind) == (200, "application/x-protobuf")
    feed = gtfs_realtime_pb2.FeedMessage()
    feed.ParseFromString(answer.content)
    newest = outside.newest("milepost/v1/full-1/state")
    (entity,) = feed.entity
    assert entity.id == entity.vehicle.vehicle.id == "full-1"
    assert entity.vehicle.position.latitude == pytest.approx(newest["latitude_deg"], abs=1e-3)
    assert entity.vehicle.position.longitude == pytest.approx(newest["longitude_deg"], abs=1e-3)
    assert abs(feed.header.timestamp - time.time()) < 5
    assert abs(entity.vehicle.timestamp - time.time()) < 5


def test_the_interval_on_the_map_holds_the_train(train):
    _, _, port = train
    answer = get(port, "/trains.geojson")
    assert (answer.status, answer.kind) == (200, "application/geo+json")
    point, interval = json.loads(answer.content)["features"]
    track = load_line(find_file(Path("airport-maglev"), "lines")).track
    ends = [track.project(y, x).position_m for x, y in interval["geometry"]["coordinates"]]
    (longitude, latitude), properties = point["geometry"]["coordinates"], point["properties"]
    assert ends == sorted(ends)
    assert ends[0] <= track.project(latitude, longitude).position_m <= ends[-1]
    assert ends[0] == pytest.approx(properties["position_min_m"], abs=0.05)
    assert ends[-1] == pytest.approx(properties["position_max_m"], abs=0.05)


def test_other_paths_and_methods_are_refused_and_a_head_has_no_body(train):
    _, _, port = train
    assert get(port, "/").content.decode().split() == ["/metrics", "/vehicle-positions.pb", "/trains.geojson"]
    assert get(port, "/metrics?x=1").status == 200
    assert get(port, "/../etc/passwd").status == 404
    assert get(port, "/metrics", "POST").status == 501
    head = get(port, "/metrics", "HEAD")
    assert (head.status, head.content) == (200, b"")


@contextmanager
def feed(endpoint: str, port: int) -> Iterator[subprocess.Popen[str]]:
    """`milepost feed` on a router; it ends within two seconds."""
    command = [sys.executable, "-m", "milepost", "feed", "--connect", endpoint, "--port", str(port)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        assert process.stderr.readline() == (
            f"milepost: http://127.0.0.1:{port} has /metrics, /vehicle-positions.pb, /trains.geojson\n"
        )
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(5.0) in (0, -signal.SIGINT)


def test_a_feed_of_its_own_sees_the_same_train(train):
    stack, _, _ = train
    port = free_port()
    with feed(stack.endpoint, port):
        found = soon(lambda: (s := scrape(port)).get(("milepost_states_total", "full-1"), 0.0) > 20.0 and s, 15.0, "states")
        # tokens of processes that were there before are known too
        assert found["milepost_process_instances", "fuser", "full-1"] == 1.0


def test_a_feed_answers_before_there_is_a_router_and_ends_on_ctrl_c():
    port = free_port()
    with feed(f"tcp/127.0.0.1:{free_port()}", port):
        assert soon(lambda: _answers(port), 5.0, "an answer") == 200
        feed_message = gtfs_realtime_pb2.FeedMessage()
        feed_message.ParseFromString(get(port, "/vehicle-positions.pb").content)
        assert not feed_message.entity
        assert json.loads(get(port, "/trains.geojson").content) == {"type": "FeatureCollection", "features": []}


def test_clients_that_say_nothing_keep_nobody_waiting():
    port = free_port()
    with feed(f"tcp/127.0.0.1:{free_port()}", port), ExitStack() as idle:
        begun = time.monotonic()
        for _ in range(50):
            idle.enter_context(socket.create_connection(("127.0.0.1", port)))
        assert get(port, "/metrics").status == 200
        assert time.monotonic() - begun < 2.0


def _answers(port: int) -> int | None:
    try:
        return urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5.0).status
    except urllib.error.URLError:
        return None


def test_a_port_that_is_in_use_is_one_line(train):
    _, _, port = train
    for command in (
        ["feed", "--port", str(port)],
        ["up", "--headless", "--listen", f"tcp/127.0.0.1:{free_port()}", "--feed", str(port)],
    ):
        said = subprocess.run([sys.executable, "-m", "milepost", *command], capture_output=True, text=True, timeout=30)
        option = "--port" if command[0] == "feed" else "--feed"
        assert (said.returncode, said.stdout) == (2, "")
        assert said.stderr.splitlines()[-1] == f"milepost: {command[0]}: {option}: 127.0.0.1:{port} is in use"
