"""The Zenoh configurations are data that Zenoh itself accepts and reads as meant."""

from __future__ import annotations

import json
from typing import Any

import pytest
import zenoh

from milepost.runtime import zenoh_config
from milepost_schemas import STREAMS

ROUTERS = ["tcp/127.0.0.1:7447", "tcp/localhost:7448"]
CONFIGS: dict[str, dict[str, Any]] = {
    "client": zenoh_config.client(ROUTERS),
    "tool": zenoh_config.tool(ROUTERS, 1500),
    "router": zenoh_config.router(["tcp/[::]:7447"]),
}
each = pytest.mark.parametrize("name", CONFIGS)


def read_back(config: dict[str, Any], key: str) -> Any:
    """What Zenoh understood under a path of its own configuration."""
    return json.loads(zenoh.Config.from_json5(json.dumps(config)).get_json(key))


def test_zenoh_refuses_a_misspelt_configuration() -> None:
    """Without this, the tests below would not show that Zenoh understands each key."""
    config = {**CONFIGS["client"], "scouting": {"multicasts": {"enabled": False}}}
    with pytest.raises(zenoh.ZError):
        zenoh.Config.from_json5(json.dumps(config))


@each
def test_nobody_is_looked_for_by_multicast_or_gossip(name: str) -> None:
    assert read_back(CONFIGS[name], "scouting/multicast/enabled") is False
    assert read_back(CONFIGS[name], "scouting/gossip/enabled") is False


@each
def test_a_lost_peer_is_noticed_within_half_a_second_and_stalls_do_not_lose_samples(name: str) -> None:
    assert read_back(CONFIGS[name], "transport/link/tx/lease") == 500
    assert read_back(CONFIGS[name], "transport/link/tx/keep_alive") == 4
    assert read_back(CONFIGS[name], "transport/link/tx/queue/congestion_control/drop/wait_before_drop") == 20000
    assert read_back(CONFIGS[name], "transport/shared_memory/enabled") is False


def test_a_service_is_a_client_that_waits_for_its_routers_as_long_as_it_takes() -> None:
    config = CONFIGS["client"]
    assert read_back(config, "mode") == "client"
    assert read_back(config, "connect/endpoints") == ROUTERS
    assert read_back(config, "connect/timeout_ms") == -1
    assert read_back(config, "connect/retry")["period_max_ms"] == 500


def test_a_tool_gives_up_soon() -> None:
    config = CONFIGS["tool"]
    assert read_back(config, "mode") == "client"
    assert read_back(config, "connect/endpoints") == ROUTERS
    assert read_back(config, "connect/timeout_ms") == 1500
    assert read_back(config, "connect/exit_on_failure") is True


def test_a_router_listens_where_it_is_told_and_connects_to_nobody() -> None:
    config = CONFIGS["router"]
    assert read_back(config, "mode") == "router"
    assert read_back(config, "listen/endpoints") == ["tcp/[::]:7447"]
    assert "connect" not in config


def test_a_linked_router_connects_to_the_others_and_does_not_wait_for_them() -> None:
    config = zenoh_config.router(["tcp/[::]:7447"], ROUTERS)
    assert read_back(config, "connect/endpoints") == ROUTERS
    assert read_back(config, "connect/exit_on_failure") is False


@each
def test_a_router_that_accepts_a_connection_and_says_nothing_is_given_up_soon(name: str) -> None:
    assert read_back(CONFIGS[name], "transport/unicast/open_timeout") == 300


def test_a_configuration_is_nobody_elses() -> None:
    """A tool changes the timeout of its own configuration; the next service's must not follow."""
    zenoh_config.tool(ROUTERS, 1)
    assert zenoh_config.client(ROUTERS)["connect"]["timeout_ms"] == -1
    assert "exit_on_failure" not in zenoh_config.client(ROUTERS)["connect"]


def test_every_priority_of_the_stream_table_has_a_queue_that_survives_a_stall():
    """With the default of 2 a burst after a stall loses samples."""
    for config in CONFIGS.values():
        sizes = read_back(config, "transport/link/tx/queue/size")
        assert {sizes[row.priority] for row in STREAMS} == {16}


def test_a_router_limits_the_size_of_every_stream() -> None:
    limits = {key: rule["size_limit"] for rule in read_back(CONFIGS["router"], "low_pass_filter") for key in rule["key_exprs"]}
    assert limits == {row.key_for("*"): row.largest_bytes for row in STREAMS}
