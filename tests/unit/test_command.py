"""The `milepost` command itself: versions, completion, mistakes."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from milepost.config.shipped_files import names_in

MILEPOST = Path(sys.executable).parent / "milepost"


def milepost(*arguments: str, folder: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    # a relative PYTHONPATH must still lead to this code from another folder
    paths = [str(Path(path).resolve()) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **environment}
    command = [str(MILEPOST), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60, check=False)


def completed(words: str) -> list[str]:
    """What bash is offered for the last of these words."""
    answer = milepost(_MILEPOST_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(words.count(" ")))
    assert answer.returncode == 0, answer.stderr
    return answer.stdout.split()


def test_version_names_both_distributions() -> None:
    said = milepost("--version")
    assert (said.returncode, said.stderr) == (0, "")
    assert said.stdout.splitlines() == [f"{name} {version(name)}" for name in ("milepost", "milepost-schemas")]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_can_be_shown_for_a_shell(shell: str) -> None:
    said = milepost("--show-completion", shell, _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1")
    assert said.returncode == 0, said.stderr
    assert "_MILEPOST_COMPLETE" in said.stdout


def test_commands_trains_and_scenarios_are_completed() -> None:
    assert completed("milepost eva") == ["evaluate"]
    assert completed("milepost up --train br") == [name for name in names_in("trains") if name.startswith("br")]
    assert completed("milepost evaluate odo") == ["odometer-radar"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["up", "--train", "metor"], "metor: neither a file nor one of the trains"),
        (["up", "--train", "missing.yaml"], "missing.yaml: No such file"),
        (["evaluate", "odometr-radar"], "odometr-radar: neither a file nor one of the scenarios"),
        (["rerun", "missing.jsonl", "--out", "out.jsonl"], "missing.jsonl: no such file"),
        (["run", "fuser", "--train", "metor"], "metor: neither a file nor one of the trains"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_a_file_that_is_not_there_is_one_line_and_exit_code_2(tmp_path: Path, arguments: list[str], line: str) -> None:
    said = milepost(*arguments, folder=tmp_path)
    assert said.returncode == 2
    assert said.stdout == ""
    assert said.stderr.startswith(f"milepost: {line}")
    assert said.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
