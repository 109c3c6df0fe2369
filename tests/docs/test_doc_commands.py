"""Every command that the documentation shows can be given; every block of code and configuration can be read."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from doc_console import steps
from doc_pages import EVERYWHERE, PAGES, ROOT, WRITTEN, Page

from milepost.cli.inject import KINDS
from milepost.cli.main import app
from milepost.config.errors import ConfigError
from milepost.config.shipped_files import find_file

TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"])
GROUP: Any = typer.main.get_group(app)
# programs that are not ours; what is checked of them is below
KNOWN = {"make", "docker", "curl", "pip", "python", "python3", "source", "prometheus", "pytest"}
LANGUAGES = {"", "sh", "console", "python", "yaml", "json5", "csv", "toml"}
# what a reader is to replace by something of his own
OWN = {"mine", "COMMAND", "SCENARIO", "CAMPAIGN", "FILE"}
FOLDERS = {"evaluate": "scenarios", "campaign": "campaigns"}


def shown(page: Page) -> Iterator[str]:
    """The commands in blocks; made pages have none."""
    for block in page.blocks:
        if block.language == "console":
            yield from (step.command for step in steps(block))
        elif block.language == "sh":
            yield from (line for line in (re.sub(r"(^|\s)#.*", "", line).strip() for line in block.lines) if line)


def named(page: Page) -> Iterator[str]:
    """What stands in backticks in the text, and begins as a command does."""
    for line in page.parts[1]:
        yield from (words for words in re.findall(r"`([^`]+)`", line) if re.match(r"(milepost|make) [a-z]", words))


SHOWN = [(page, line) for page in EVERYWHERE for line in shown(page)]
NAMED = sorted({line for page in EVERYWHERE for line in named(page)})


def parsed(line: str) -> tuple[str, Any]:
    """A command of ours and its parameters; raises what typer raises where it cannot be given."""
    words = shlex.split(re.split(r"\s[>|&]", line)[0])[1:]
    command, path = GROUP, []
    while hasattr(command, "commands"):
        assert words[0] in command.commands, line
        command = command.commands[words[0]]
        path.append(words.pop(0))
    return " ".join(path), command.make_context(path[-1], words).params


def check_files(page: Page, name: str, parameters: dict[str, Any]) -> None:
    """What a command takes by name is shipped, and what it takes by path is written on a page."""
    written = {title for each in EVERYWHERE for title in each.files}
    given = [(each, "trains") for each in [parameters.get("train")] if each]
    given = [(Path(train), folder) for trains, folder in given for train in (trains if isinstance(trains, list) else [trains])]
    given += [(Path(fleet), "fleets") for fleet in [parameters.get("fleet")] if fleet]
    given += [(Path(parameters[key]), FOLDERS[name]) for key in ("scenario", "file") if name in FOLDERS and parameters.get(key)]
    for path, folder in given:
        if path.stem in OWN or path.name in written or (ROOT / path).is_file() or name in ("watch", "rerun"):
            continue
        try:
            find_file(path, folder)
        except ConfigError as error:
            pytest.fail(f"{page.name}: {name}: {error}")


@pytest.mark.parametrize(("page", "line"), SHOWN, ids=lambda value: value if isinstance(value, str) else value.path.stem)
def test_a_command_in_a_block_can_be_given(page: Page, line: str) -> None:
    words = shlex.split(line)
    program = words[0].removeprefix(".venv/bin/")
    if program == "milepost":
        name, parameters = parsed(line)
        check_files(page, name, parameters)
        if name == "inject" and not parameters.get("show_list"):
            assert_fault(line)
        return
    assert program in KNOWN, f"{page.name}: {line}: say in this test how it is checked"
    if program == "make":
        assert words[1] in TARGETS
    for extra in re.findall(r"\.\[([a-z,]+)\]", line):
        assert set(extra.split(",")) <= EXTRAS
    for file in re.findall(r"-f (\S+)", line) if program == "docker" else ():
        assert (ROOT / file).is_file()


def assert_fault(line: str) -> None:
    """The kind of fault is in the table, and has these options."""
    words = [word for word in shlex.split(line)[2:] if not word.startswith("--clear")]
    kinds = [KINDS[word] for word in words if word in KINDS]
    known = {"--for", "--train", "--connect", "--zenoh-config", "--list"}
    known |= {f"--{key.replace('_', '-')}" for kind in kinds for key in kind.options.model_fields}
    assert {word for word in words if word.startswith("--")} <= known, line


@pytest.mark.parametrize("line", NAMED)
def test_a_command_in_the_text_exists_with_its_options(line: str) -> None:
    words = shlex.split(line)
    if words[0] == "make":
        assert words[1] in TARGETS
        return
    if words[1] in OWN:
        return
    command = GROUP.commands[words[1]]
    if hasattr(command, "commands") and len(words) > 2:
        command = command.commands[words[2]]
    options = {name for parameter in command.params for name in parameter.opts} | {"--help"}
    if words[1] == "inject":
        assert_fault(line)
    else:
        assert {word for word in words if word.startswith("--")} <= options


def test_a_wrong_command_is_found() -> None:
    for line in ("milepost up --trian full", "milepost evaluate ./x.yaml --runs none", "milepost info", "milepost pki isue"):
        with pytest.raises(Exception, match=r".*"):
            parsed(line)


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.name)
def test_a_block_can_be_read(page: Page) -> None:
    for block in page.blocks:
        assert block.language in LANGUAGES, f"{page.name}: {block.language}"
        if block.language == "python":
            # a line of a table that is added somewhere is Python within brackets
            compile(block.text.strip() if not block.text.startswith(" ") else f"[{block.text}]", page.name, "exec")
        elif block.language == "toml":
            tomllib.loads(block.text)
        elif block.language == "yaml":
            assert yaml.safe_load(block.text) is not None


def test_commands_are_found() -> None:
    assert len(SHOWN) > 60
    assert len(NAMED) > 40
    assert {page.name for page in PAGES} >= {"docs/index.md", "docs/tutorial/first-run.md"}
