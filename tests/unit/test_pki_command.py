"""`milepost pki`, `milepost acl` and `--zenoh-config`: what they make, and mistakes in one line."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from milepost.config.shipped_files import find_file
from milepost.config.train import load_train

METRO = "metro"


def milepost(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "milepost", *words], capture_output=True, text=True, timeout=60.0, check=False)


@pytest.fixture
def pki(tmp_path: Path) -> Path:
    pytest.importorskip("cryptography")
    folder = tmp_path / "pki"
    done = milepost("pki", "init", "--train", METRO, "--dir", str(folder), "--days", "2")
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    return folder


def test_init_makes_a_folder_for_each_name_with_all_that_a_session_needs(pki: Path) -> None:
    from milepost.security.access import names

    train = load_train(find_file(Path(METRO), "trains"))
    assert {path.name for path in pki.iterdir()} == {"ca.pem", "ca.key", *names(train)}
    for name in set(names(train)) - {"router-2"}:  # one endpoint, one router
        assert {path.name for path in (pki / name).iterdir()} == {"ca.pem", "identity.pem", "session.json5"}
        zenoh.Config.from_file(str(pki / name / "session.json5"))
    assert pki.stat().st_mode & 0o777 == 0o700


def test_what_is_there_is_not_made_again(pki: Path) -> None:
    done = milepost("pki", "init", "--train", METRO, "--dir", str(pki))
    assert done.returncode == 2
    assert done.stderr == f"milepost: {pki}/ca.pem: there is an authority already; `milepost pki issue` goes on with it\n"


def test_issue_replaces_one_certificate_and_keeps_a_routers_names(pki: Path) -> None:
    from milepost.security.authority import hosts_of

    before = {path.parent.name: path.read_bytes() for path in pki.glob("*/identity.pem")}
    hosts = hosts_of(pki / "router" / "identity.pem")
    assert milepost("pki", "issue", "router", "--train", METRO, "--dir", str(pki)).returncode == 0
    after = {path.parent.name: path.read_bytes() for path in pki.glob("*/identity.pem")}
    assert [name for name in before if before[name] != after[name]] == ["router"]
    assert hosts_of(pki / "router" / "identity.pem") == hosts == ["router", "localhost", "127.0.0.1", "::1"]
    wrong = milepost("pki", "issue", "fusser", "--train", METRO, "--dir", str(pki))
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("milepost: pki issue: NAME: ")
    assert len(wrong.stderr.splitlines()) == 1


@pytest.mark.parametrize("words", [["issue", "fuser"], ["rotate"]], ids=lambda words: words[0])
def test_another_trains_authority_is_refused_and_nothing_is_issued(pki: Path, words: list[str]) -> None:
    before = {path: path.read_bytes() for path in pki.rglob("*.pem")}
    done = milepost("pki", *words, "--train", "full", "--dir", str(pki))
    text = f"{pki}/ca.pem: is the authority of metro-1, not of full-1; name its train with `--train`"
    assert (done.returncode, done.stderr) == (2, f"milepost: {text}\n")
    assert {path: path.read_bytes() for path in pki.rglob("*.pem")} == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["pki", "rotate", "--train", METRO, "--dir", "nowhere"],
            "milepost: nowhere/ca.pem: no such file; `milepost pki init` makes",
        ),
        (
            ["pki", "init", "--train", METRO, "--dir", "x", "--listen", "tcp/a:1"],
            "milepost: pki init: --listen, --connect: 'tcp/a:1' is not tls",
        ),
        (
            ["pki", "init", "--train", METRO, "--dir", "x", "--connect", "tls/a:1", "--connect", "tls/b:1"],
            "milepost: pki init: --connect: there",
        ),
        (["status", "--zenoh-config", "nowhere.json5"], "milepost: nowhere.json5: no such file"),
        (["watch", "--zenoh-config", "nowhere.json5"], "milepost: nowhere.json5: no such file"),
        (
            ["inject", "radar", "bias", "--size", "1", "--zenoh-config", "nowhere.json5"],
            "milepost: nowhere.json5: no such file",
        ),
        (["run", "fuser", "--zenoh-config", "nowhere.json5"], "milepost: nowhere.json5: no such file"),
        (["run", "router", "--config", "nowhere.json5"], "milepost: nowhere.json5: no such file"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(words: list[str], said: str) -> None:
    if words[0] == "pki":
        pytest.importorskip("cryptography")
    done = milepost(*words)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr


def test_acl_prints_what_zenoh_takes() -> None:
    done = milepost("acl", "--train", METRO)
    assert done.returncode == 0
    zenoh.Config.from_json5(done.stdout)
    assert json.loads(done.stdout)["access_control"]["default_permission"] == "deny"


@pytest.mark.parametrize("host", ["", " ", "a b", "*", "*.example.com", "-x", "tcp/127.0.0.1", "zürich"])
def test_a_host_that_can_be_none_is_refused_before_anything_is_made(host: str, tmp_path: Path) -> None:
    wrong = milepost("pki", "init", "--train", METRO, "--dir", str(tmp_path / "pki"), f"--host={host}")
    assert (wrong.returncode, wrong.stderr) == (2, f"milepost: pki init: --host: {host!r} is no name or address of a host\n")
    assert not (tmp_path / "pki").exists()
