"""A whole session configuration from a file: what it says goes before Milepost's own settings, which stay otherwise."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import zenoh

from milepost.config.errors import ConfigError
from milepost.runtime import zenoh_config


def write(folder: Path, **content) -> Path:
    path = folder / "session.json5"
    path.write_text("// a comment, as JSON5 allows\n" + json.dumps(content), encoding="utf-8")
    return path


def test_what_the_file_says_goes_first_and_the_rest_stays(tmp_path: Path) -> None:
    path = write(tmp_path, connect={"endpoints": ["tcp/a:1"], "timeout_ms": 77}, transport={"link": {"tx": {"lease": 900}}})
    for config in (zenoh_config.client(path), zenoh_config.tool(path)):
        assert config["connect"]["endpoints"] == ["tcp/a:1"]
        assert config["connect"]["timeout_ms"] == 77
        assert config["transport"]["link"]["tx"]["lease"] == 900
        assert config["transport"]["link"]["tx"]["queue"] == zenoh_config.client([])["transport"]["link"]["tx"]["queue"]
        assert config["scouting"]["multicast"]["enabled"] is False
        assert config["mode"] == "client"
        zenoh.Config.from_json5(json.dumps(config))


def test_a_tool_still_gives_up_soon_and_a_service_still_waits(tmp_path: Path) -> None:
    path = write(tmp_path, connect={"endpoints": ["tcp/a:1"]})
    assert zenoh_config.tool(path)["connect"]["timeout_ms"] == 2000
    assert zenoh_config.client(path)["connect"]["timeout_ms"] == -1


def test_certificates_lie_beside_the_file_wherever_the_process_runs(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "ca.pem").touch()
    path = write(tmp_path, transport={"link": {"tls": {"root_ca_certificate": "ca.pem"}}})
    monkeypatch.chdir(tmp_path.parent)
    tls = zenoh_config.client(Path(tmp_path.name) / path.name)["transport"]["link"]["tls"]
    assert tls["root_ca_certificate"] == str(tmp_path / "ca.pem")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no such file"),
        (
            {"transport": {"link": {"tls": {"connect_private_key": "k.pem"}}}},
            r"transport\.link\.tls\.connect_private_key: .*k\.pem",
        ),
        ({"transports": {}}, "unknown field `transports`"),
    ],
)
def test_an_unusable_file_is_named_with_what_is_wrong_in_one_line(tmp_path: Path, content, said: str) -> None:
    path = tmp_path / "session.json5" if content is None else write(tmp_path, **content)
    with pytest.raises(ConfigError, match=said) as caught:
        zenoh_config.tool(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
