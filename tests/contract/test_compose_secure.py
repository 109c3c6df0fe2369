"""compose.secure.yaml gives each container of compose.yaml its own certificate, read-only, and changes nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from milepost.cli.composing.compose import Beside, compose
from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.security.access import names

ROOT = Path(__file__).parents[2]


def services(file: str) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / file).read_text(encoding="utf-8"))["services"]
    return found


OPEN, SECURE = services("compose.yaml"), services("compose.secure.yaml")


def printed(given: str, **beside: bool) -> str:
    """What `milepost compose GIVEN --secure` prints."""
    return compose(find_file(Path(given), "trains"), given, Beside(**beside), secure=True)[0]


def test_it_is_what_the_command_prints() -> None:
    assert printed("full") == (ROOT / "compose.secure.yaml").read_text(encoding="utf-8"), "milepost compose full --secure"


@pytest.mark.parametrize("train", ["metro", "full-2oo3"])
def test_of_another_train_each_container_has_a_certificate_that_there_is(train: str) -> None:
    """What runs beside it too; who looks at its own health by asking for a state has a reader's as well."""
    beside = dict.fromkeys(("record", "feed", "page"), True)
    path = find_file(Path(train), "trains")
    whole = yaml.safe_load(compose(path, train, Beside(**beside))[0])["services"]
    secure = yaml.safe_load(printed(train, **beside))["services"]
    assert list(secure) == list(whole)
    assert set(secure) <= set(names(load_train(path)))
    for name, service in secure.items():
        own = f"${{MILEPOST_PKI:-./pki}}/{name}:/run/milepost:ro"
        asks = "milepost status" in str(whole[name]["healthcheck"]) or name.startswith("router")
        assert service["volumes"] == [own, *(["${MILEPOST_PKI:-./pki}/dispatch:/run/dispatch:ro"] if asks else [])]


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
