"""compose.record.yaml and compose.page.yaml make of compose.yaml what `milepost compose full` prints with that option."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from milepost.cli.composing.compose import Beside, compose
from milepost.config.shipped_files import find_file

ROOT = Path(__file__).parents[2]
OVERLAYS = {"record": Beside(record=True), "page": Beside(page=True)}


def read(text: str) -> dict[str, Any]:
    """Services, each without what is only in the file for reading, and volumes."""
    found = yaml.safe_load(text)
    return {"services": found["services"], "volumes": found.get("volumes", {})}


@pytest.mark.parametrize("name", OVERLAYS)
def test_an_overlay_adds_what_the_option_adds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN compose.yaml with an overlay, THEN its services are those of the file that the option prints."""
    monkeypatch.chdir(ROOT)
    printed, _ = compose(find_file(Path("full"), "trains"), "full", OVERLAYS[name])
    merged = read((ROOT / "compose.yaml").read_text(encoding="utf-8"))
    over = read((ROOT / f"compose.{name}.yaml").read_text(encoding="utf-8"))
    for service, fields in over["services"].items():
        merged["services"][service] = {**merged["services"].get(service, {}), **fields}
    merged["volumes"] |= over["volumes"]
    assert merged == read(printed)


@pytest.mark.parametrize(("service", "port"), [("feed", 9470), ("page", 9480)])
def test_a_web_server_is_reachable_from_this_machine_only_and_says_where(
    service: str, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a train with feed and page, THEN each is published on 127.0.0.1 alone, and is told the address that people use."""
    monkeypatch.chdir(ROOT)
    printed, _ = compose(find_file(Path("full"), "trains"), "full", Beside(feed=True, page=True))
    fields = read(printed)["services"][service]
    published = f"127.0.0.1:${{MILEPOST_{service.upper()}_PORT:-{port}}}"
    assert fields["ports"] == [f"{published}:{port}"]
    assert fields["command"][-2:] == ["--url", f"http://{published}"]


def test_the_image_has_what_web_servers_need() -> None:
    image = (ROOT / "deploy" / "Dockerfile").read_text(encoding="utf-8")
    assert 'extras["metrics"]' in image
    assert 'extras["page"]' in image
