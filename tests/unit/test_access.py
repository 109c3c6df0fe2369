"""Access control follows the tables: a process may send what its role sends, and nothing else."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import zenoh

from milepost.config.errors import ConfigError
from milepost.config.roles import ROLES, processes
from milepost.config.train import Train, load_train
from milepost.security.access import ROUTERS, TOOLS, accesses, names
from milepost.security.rules import access_control
from milepost_schemas import BY_NAME, STREAMS

TRAINS = Path(__file__).parents[2] / "deploy" / "trains"
FULL = load_train(TRAINS / "full.yaml")
CONTROL = access_control(FULL)
TOP = "milepost/v1/full-1"
RULES = {rule["id"]: rule for rule in CONTROL["rules"]}


def allowed(name: str, flow: str, message: str, key: str, train: Train = FULL) -> bool:
    """Whether some rule of a name includes a key expression, as Zenoh decides it."""
    control = CONTROL if train is FULL else access_control(train)
    rules = {rule["id"]: rule for rule in control["rules"]}
    mine = [rules[rule] for policy in control["policies"] if policy["id"] == name for rule in policy["rules"]]
    return any(
        zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key))
        for rule in mine
        if flow in rule["flows"] and message in rule["messages"]
        for expression in rule["key_exprs"]
    )


def sends(name: str, key: str) -> bool:
    return allowed(name, "ingress", "put", f"{TOP}/{key}")


def test_zenoh_takes_it_and_denies_what_it_does_not_name() -> None:
    read = zenoh.Config.from_json5(json.dumps({"access_control": CONTROL}))
    assert json.loads(read.get_json("access_control/enabled")) is True
    assert json.loads(read.get_json("access_control/default_permission")) == "deny"
    assert {rule["permission"] for rule in CONTROL["rules"]} == {"allow"}


def test_everybody_has_a_policy_of_its_own_and_is_known_by_certificate_alone() -> None:
    subjects = {subject["id"]: subject for subject in CONTROL["subjects"]}
    assert set(subjects) == {*(set(names(FULL)) - set(ROUTERS)), "routers"}
    for name, subject in subjects.items():
        assert subject["cert_common_names"] == (list(ROUTERS) if name == "routers" else [name])
        assert subject["link_protocols"] == ["tls"]
    assert {policy["id"]: policy["subjects"] for policy in CONTROL["policies"]} == {name: [name] for name in subjects}


@pytest.mark.parametrize("process", processes(FULL, live=True), ids=lambda process: process.name)
def test_a_process_sends_the_streams_of_its_role_its_health_and_events(process) -> None:
    expected = {BY_NAME[name].key_for(FULL.name, process.unit) for name in ROLES[process.role].sends(FULL, process.unit)}
    expected |= {f"{TOP}/event", f"{TOP}/health/{process.name}"}
    found = {key for key in RULES[f"{process.name}: sends"]["key_exprs"] if "@adv" not in key}
    assert found == expected


@pytest.mark.parametrize("process", processes(FULL, live=True), ids=lambda process: process.name)
def test_a_process_does_not_send_what_another_one_owns(process) -> None:
    mine = set(RULES[f"{process.name}: sends"]["key_exprs"])
    for other in processes(FULL, live=True):
        owned = {BY_NAME[name].key_for(FULL.name, other.unit) for name in ROLES[other.role].sends(FULL, other.unit)}
        if (other.role, process.role) != ("fuser", "fuser") and other != process:
            assert not owned & mine
        assert other == process or not allowed(process.name, "ingress", "liveliness_token", f"{TOP}/alive/{other.name}/x")


@pytest.mark.parametrize(
    "key", ["reading/radar-rear", "reading/*", "state", "feedback", "estimate/radar-front", "fix/balise", "**"]
)
def test_a_radar_sends_its_own_reading_alone(key: str) -> None:
    assert sends("sensor-radar-front", "reading/radar-front")
    assert not sends("sensor-radar-front", key)


@pytest.mark.parametrize("name", ["dispatch", "display", "observer"])
def test_a_tool_that_reads_sends_nothing_at_all(name: str) -> None:
    flows = [RULES[rule] for rule in RULES if rule.startswith(f"{name}: ") and RULES[rule]["flows"] == ["ingress"]]
    asked = {message for rule in flows for message in rule["messages"]}
    assert asked == {"declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"}
    for stream in STREAMS:
        assert allowed(name, "egress", "put", stream.key_for("full-1", "x")) == (stream.name != "chaos")


def test_faults_are_sent_only_where_the_train_file_allows_them_and_only_by_the_tool_for_it() -> None:
    assert FULL.file.chaos
    senders = [name for name in names(FULL) if name not in ROUTERS and sends(name, "@chaos/imu")]
    assert senders == ["chaos"]
    quiet = load_train(TRAINS / "full.yaml", {"chaos": False})
    for name in (each.name for each in accesses(quiet)):
        assert not allowed(name, "ingress", "put", f"{TOP}/@chaos/imu", quiet)
        # a recorder would write down what nobody may send
        assert name == "recorder" or not allowed(name, "egress", "put", f"{TOP}/@chaos/imu", quiet)


def test_only_a_process_that_remembers_answers_for_the_fused_state() -> None:
    key = f"{TOP}/@rpc/latest_feedback"
    for process in processes(FULL, live=True):
        remembers = process.role in ("fuser", "filter")
        assert allowed(process.name, "ingress", "declare_queryable", f"{key}/{process.name}") == remembers
        assert allowed(process.name, "ingress", "reply", f"{key}/{process.name}") == remembers
        assert not allowed(process.name, "ingress", "reply", f"{key}/other")
    assert [name for name in names(FULL) if name not in ROUTERS and allowed(name, "ingress", "reply", f"{TOP}/@sim/start")] == [
        "world"
    ]


def test_only_replicas_ask_each_other_for_all_that_a_fuser_knows() -> None:
    key = f"{TOP}/@rpc/snapshot"
    for name in (each.name for each in accesses(FULL)):
        replica = name in ("fuser", "fuser-2")
        assert allowed(name, "ingress", "query", f"{key}/*") == replica
        assert allowed(name, "egress", "query", f"{key}/*") == replica
        assert allowed(name, "egress", "reply", f"{key}/fuser") == replica
        for answering in ("fuser", "fuser-2"):
            assert allowed(name, "ingress", "declare_queryable", f"{key}/{answering}") == (name == answering)
            assert allowed(name, "ingress", "reply", f"{key}/{answering}") == (name == answering)


@pytest.mark.parametrize("train", ["maglev", "full-2oo3"])
def test_nobody_asks_for_it_where_there_is_one_fuser_or_a_voter(train: str) -> None:
    control = json.dumps(access_control(load_train(TRAINS / f"{train}.yaml")))
    assert "latest_feedback" in control
    assert "snapshot" not in control


@pytest.mark.parametrize("path", sorted(TRAINS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_train_has_one(path: Path) -> None:
    try:
        train = load_train(path)
        control = access_control(train)
    except ConfigError as error:
        if "no such file" in str(error).lower():
            pytest.skip("its recording is not here")
        raise
    assert len(control["subjects"]) == len(processes(train, live=True)) + len(TOOLS) + len(["recorder", "routers"])


def test_a_recorder_hears_every_recorded_stream_and_sends_only_its_own_event_and_health() -> None:
    for stream in STREAMS:
        key = stream.key_for("full-1", "x")
        heard = allowed("recorder", "egress", "put", key) and allowed("recorder", "ingress", "declare_subscriber", key)
        assert heard == stream.recorded
    sent = {key for key in RULES["recorder: sends"]["key_exprs"] if "@adv" not in key}
    assert sent == {f"{TOP}/event", f"{TOP}/health/recorder"}
