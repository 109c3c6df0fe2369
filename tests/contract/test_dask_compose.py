"""deploy/dask-compose.yaml: a scheduler and two workers of the project's image."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]
SERVICES: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / "deploy/dask-compose.yaml").read_text(encoding="utf-8"))[
    "services"
]


def test_a_scheduler_and_two_workers_share_the_projects_image() -> None:
    compose = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]
    assert {service["image"] for service in SERVICES.values()} == {compose["fuser"]["image"]}
    assert set(SERVICES) == {"scheduler", "worker"}
    assert SERVICES["worker"]["deploy"]["replicas"] == 2
    assert SERVICES["worker"]["command"][0] == "tcp://scheduler:8786"


def test_workers_wait_for_a_scheduler_that_listens() -> None:
    assert SERVICES["worker"]["depends_on"] == {"scheduler": {"condition": "service_healthy"}}
    assert "8786" in SERVICES["scheduler"]["healthcheck"]["test"][-1]


def test_the_cluster_runs_with_the_least_privileges() -> None:
    for service in SERVICES.values():
        assert (service["read_only"], service["cap_drop"]) == (True, ["ALL"])
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert not {"privileged", "cap_add", "network_mode", "pid", "user"} & set(service)
    assert SERVICES["scheduler"]["ports"] == ["127.0.0.1:${MILEPOST_DASK_PORT:-8786}:8786"]
    assert "ports" not in SERVICES["worker"]


def test_image_and_lock_have_what_dask_needs() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(extras["dask"]) <= set(extras["dev"])
    assert 'extras["dask"]' in (ROOT / "deploy/Dockerfile").read_text(encoding="utf-8")
    assert "\ndistributed==" in (ROOT / "requirements.lock").read_text(encoding="utf-8")
