"""The `milepost` command itself: versions, completion, mistakes."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import pytest
import typer

from milepost.cli.inject import Wanted, fields_of
from milepost.cli.main import app, main
from milepost.config.errors import ConfigError
from milepost.config.shipped_files import names_in


class Said(NamedTuple):
    """How a command ended, and what it printed."""

    code: object
    out: str
    err: str


class Command:
    """`milepost` in this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys

    def run(self, *arguments: str, **environment: str) -> Said:
        self._monkeypatch.setattr(sys, "argv", ["milepost", *arguments])
        for name, value in environment.items():
            self._monkeypatch.setenv(name, value)
        with pytest.raises(SystemExit) as ended:
            main()
        return Said(ended.value.code, *self._capsys.readouterr())

    def completed(self, words: str) -> list[str]:
        """What bash is offered for the last of these words."""
        said = self.run(_MILEPOST_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(words.count(" ")))
        assert said.code == 0, said.err
        return said.out.split()


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return Command(monkeypatch, capsys)


def test_version_names_both_distributions() -> None:
    said = subprocess.run([Path(sys.executable).parent / "milepost", "--version"], capture_output=True, text=True, check=True)
    assert said.stdout.splitlines() == [f"{name} {version(name)}" for name in ("milepost", "milepost-schemas")]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_can_be_shown_for_a_shell(command: Command, shell: str) -> None:
    said = command.run("--show-completion", shell, _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert said.code == 0, said.err
    assert "_MILEPOST_COMPLETE" in said.out


def test_commands_are_completed(command: Command) -> None:
    assert command.completed("milepost eva") == ["evaluate"]


def test_trains_are_completed_by_name(command: Command) -> None:
    trains = [name for name in names_in("trains") if name.startswith("br")]
    assert len(trains) > 1
    assert command.completed("milepost up --train br") == trains


def test_scenarios_are_completed_by_name(command: Command) -> None:
    assert command.completed("milepost evaluate odo") == ["odometer-radar"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["up", "--train", "metor"], "metor: neither a file nor one of the trains"),
        (["up", "--train", "missing.yaml"], "missing.yaml: No such file"),
        (["run", "fuser", "--train", "metor"], "metor: neither a file nor one of the trains"),
        (["evaluate", "odometr-radar"], "odometr-radar: neither a file nor one of the scenarios"),
        (["rerun", "missing.jsonl", "--out", "out.jsonl"], "missing.jsonl: no such file"),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, list) else None,
)
def test_a_missing_file_is_one_line_and_exit_code_2(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    said = command.run(*arguments)
    assert (said.code, said.out) == (2, "")
    *progress, mistake = said.err.splitlines()
    assert mistake.startswith(f"milepost: {line}")
    assert all(each.startswith("milepost: reading ") for each in progress)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("moment", ["typer.main.get_command", "milepost.config.shipped_files.find_file"])
def test_ctrl_c_while_the_command_line_is_read_leaves_no_traceback(moment: str) -> None:
    """WHEN Ctrl-C comes while the commands are built, or before a command's own code runs, THEN `up` ends without a word."""
    module, _, name = moment.rpartition(".")
    program = f"""
import importlib, os, signal, sys
module = importlib.import_module({module!r})
real = module.{name}
def interrupted(*arguments, **options):
    os.kill(os.getpid(), signal.SIGINT)
    return real(*arguments, **options)
module.{name} = interrupted
sys.argv = ["milepost", "up", "--headless", "--listen", "tcp/127.0.0.1:1"]
from milepost.cli.entry import main
main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode in (130, -signal.SIGINT)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("campaign", "campaign: FILE: required: campaign file, or the name of one: "),
        (
            "run",
            "run: ROLE: required: one of router, world, sensor, filter, balise, fuser, voter, etcs, recorder, together; see ",
        ),
        ("run sensor", "run: UNIT: required: one of odometer-front, "),
        (
            "run sensr",
            "run: ROLE: must be one of router, recorder, together, etcs, voter, fuser, filter, balise, sensor, world, not",
        ),
        ("rerun", "rerun: READINGS: required: recorded messages: "),
        ("rerun x", "rerun: --out: required: file for the settled states, one per line; see `milepost rerun --help`"),
        ("evaluate", "evaluate: Invalid value for SCENARIO: name one scenario, or use --all; see `milepost evaluate --help`"),
        ("inject", "inject: UNIT: required; "),
        ("inject radar", "inject: FAULT: required: one of bias, "),
        ("inject radar --list", "inject: --list: shows the faults of all units; leave out radar"),
        ("inject radar --clear bias", "inject: --clear: ends all faults of a unit; name no other"),
        ("up --duration abc", "up: Invalid value for '--duration': "),
        ("up --duration", "Option '--duration' requires an argument; see `milepost --help`"),
        ("up --trian x", "up: No such option: --trian (Possible options: --train); see `milepost up --help`"),
        ("up --fleet three-trains --train metro", "up: --fleet: names its trains itself; leave out --train"),
        ("up --connect tcp/a:1 --listen tcp/b:1", "up: --connect: joins a router that runs; leave out --listen"),
        ("up --secure --train metro --train maglev", "up: --secure: is for one train with a router of its own"),
        ("up --secure --connect tcp/a:1", "up: --secure: is for one train with a router of its own"),
        ("up --external radar --fleet three-trains", "up: --external: is for one train; a fleet file has `external` for each"),
        (
            "up --fleet tree-trains",
            "tree-trains: neither a file nor one of the fleets: three-trains, two-hundred; did",
        ),
        ("up metro", "up: Got unexpected extra argument(s) (metro); did you mean `--train metro`?; see `milepost up --help`"),
        ("acl metro", "acl: Got unexpected extra argument(s) (metro); did you mean `--train metro`?"),
        ("pki rotate metro", "pki: rotate: Got unexpected extra argument(s) (metro); did you mean `--train metro`?"),
        ("inject fuser bit_flip --covariance=true", "inject: --covariance: takes no value; --no-covariance is its opposite"),
        ("inject fuser bit_flip --covariance true", "inject: true: not an option of bit_flip, which has --bit, "),
        ("inject radar bias --no-size 1", "inject: --no-size: not an option of bias, which has --size"),
        ("bogus", "No such command 'bogus'; see `milepost --help`"),
        ("run router --config router.json5 --link tcp/127.0.0.1:1", "run: --link: not with --config: router.json5 says itself"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_line_that_says_what_to_give(
    command: Command, root: Path, monkeypatch: pytest.MonkeyPatch, words: str, line: str
) -> None:
    monkeypatch.chdir(root / "deploy/zenoh")
    said = command.run(*words.split())
    assert (said.code, said.out) == (2, "")
    (mistake,) = said.err.splitlines()
    assert mistake.startswith(f"milepost: {line}")


def test_the_command_alone_shows_its_help(command: Command) -> None:
    said = command.run()
    assert "evaluate" in said.out + said.err
    assert "Usage:" in said.out + said.err


def test_every_command_takes_its_train_by_the_same_option() -> None:
    """`inject` and `watch` take the name of a running one, others a train file or its name; nowhere is it an argument."""
    commands = dict(typer.main.get_group(app).commands)
    commands |= {f"pki {name}": command for name, command in commands.pop("pki").commands.items()}
    taking = {(name, *p.opts) for name, command in commands.items() for p in command.params if p.name == "train"}
    named = {"up", "watch", "run", "compose", "rerun", "chaos", "inject", "acl", "pki init", "pki issue", "pki rotate"}
    assert taking == {(name, "--train") for name in named}


def test_the_list_of_faults_states_ranges_defaults_and_flags(command: Command) -> None:
    said = command.run("inject", "--list").out
    assert re.search(r"^spin .*\n    --ratio +the wheel turns at .* \(> 0, required\)$", said, re.M)
    assert re.search(r"^slide .*\n    --ratio +the wheel turns at .* \(≥ -1, < 0, required\)$", said, re.M)
    assert re.search(r"^    --std +the standard deviation; .* \(> 0\)$", said, re.M)
    assert re.search(r"^    --covariance/--no-covariance .* \(default off\)$", said, re.M)
    rows = {row["fault"]: row["options"] for row in json.loads(command.run("inject", "--list", "--json").out)}
    assert rows["spin"]["ratio"]["exclusiveMinimum"] == 0.0
    assert (rows["bit_flip"]["bit"]["minimum"], rows["bit_flip"]["bit"]["maximum"]) == (0, 63)


@pytest.mark.parametrize(
    ("typed", "flags"),
    [
        ("fuser bit_flip --covariance --bit 3", {"covariance": True}),
        ("fuser bit_flip --no-covariance", {"covariance": False}),
        ("balise-reader wrong_balise --no-once", {"once": False}),
        ("balise-reader wrong_balise", {}),
    ],
)
def test_a_flag_of_a_fault_needs_no_value(typed: str, flags: dict[str, bool]) -> None:
    unit, fault, *options = typed.split()
    assert fields_of(Wanted(unit, fault, options, None, False, ""))["flags"] == flags


@pytest.mark.parametrize(("words", "option"), [("feed", "--port"), ("up --feed 9470", "--feed")])
def test_a_missing_library_of_the_web_server_is_one_line_that_says_what_to_install(
    command: Command, monkeypatch: pytest.MonkeyPatch, words: str, option: str
) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    said = command.run(*words.split(), "--connect" if words == "feed" else "--listen", "tcp/127.0.0.1:1")
    assert (said.code, said.out) == (2, "")
    line = f"milepost: {words.split()[0]}: {option}: needs prometheus-client and gtfs-realtime-bindings: pip install "
    assert said.err.splitlines()[-1].startswith(f"{line}'milepost[metrics]'")


def test_events_are_listed_with_severity_and_meaning(command: Command) -> None:
    said = command.run("events")
    assert said.code in (0, None)
    assert re.search(r"^unit_excluded +warning +a unit no longer counts, with the evidence$", said.out, re.M)
    rows = json.loads(command.run("events", "--json").out)
    assert len(rows) == len(said.out.splitlines())
    row = {
        "code": "second_instance",
        "severity": "error",
        "meaning": "a process runs twice",
        "action": "end all instances but one",
    }
    assert row in rows


def test_an_option_of_a_fault_that_is_missing_is_named_as_it_is_typed() -> None:
    with pytest.raises(ConfigError, match=r"^inject: jump: --size: required$"):
        fields_of(Wanted("gnss", "jump", [], None, False, ""))
