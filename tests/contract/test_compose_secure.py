"""compose.secure.yaml gives each container of compose.yaml its own certificate, read-only, and changes nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]


def services(file: str) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / file).read_text(encoding="utf-8"))["services"]
    return found


OPEN, SECURE = services("compose.yaml"), services("compose.secure.yaml")


def test_no_container_is_left_out() -> None:
    assert sorted(SECURE) == sorted(OPEN)


@pytest.mark.parametrize("name", OPEN)
def test_a_container_sees_its_own_certificate_alone_and_cannot_write_it(name: str) -> None:
    reads = name.startswith(("router", "fuser"))  # their healthcheck asks as a tool that only reads
    expected = [f"${{MILEPOST_PKI:-./pki}}/{name}:/run/milepost:ro"]
    expected += ["${MILEPOST_PKI:-./pki}/dispatch:/run/dispatch:ro"] if reads else []
    assert SECURE[name]["volumes"] == expected
    assert SECURE[name]["environment"] == {"MILEPOST_ZENOH_CONFIG": "/run/milepost/session.json5"}


@pytest.mark.parametrize("name", OPEN)
def test_nothing_else_is_changed(name: str) -> None:
    allowed = {"volumes", "environment"}
    if name.startswith("router"):
        allowed |= {"command", "healthcheck"}
        assert SECURE[name]["command"] == ["run", "router", "--config", "/run/milepost/session.json5"]
    if name.startswith("fuser"):
        allowed |= {"healthcheck"}
    assert set(SECURE[name]) <= allowed


@pytest.mark.parametrize("name", OPEN)
def test_a_container_cannot_take_the_machine_from_the_others(name: str) -> None:
    limits = {key: OPEN[name].get(key) for key in ("mem_limit", "memswap_limit", "cpus", "pids_limit")}
    assert limits == {"mem_limit": "384m", "memswap_limit": "384m", "cpus": 1.0, "pids_limit": 128}
