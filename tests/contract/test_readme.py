"""The README's commands exist, its files are there, and its figures stand one in a cell."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from milepost.cli.inject import KINDS
from milepost.cli.main import app
from milepost.config.shipped_files import find_file, names_in
from milepost.estimation.filters import FILTERS
from milepost.sensors import SENSORS
from milepost_schemas import STREAMS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
GUIDES = [
    README,
    *(
        (ROOT / name).read_text(encoding="utf-8")
        for name in ("CONTRIBUTING.md", "docs/add-a-sensor.md", "docs/fleets.md", "docs/machines.md", "docs/recordings.md")
    ),
]


def commands(text: str) -> Iterator[str]:
    """What stands in backticks, and the lines of shell blocks without their comments."""
    language: str | None = None
    for line in text.splitlines():
        if line.startswith("```"):
            language = line[3:] if language is None else None
        elif language is None:
            yield from re.findall(r"`([^`]+)`", line)
        elif language in ("", "sh"):
            yield line.split(" #")[0].strip()


COMMANDS = [command for text in GUIDES for command in commands(text)]
MILEPOST = sorted({line for line in COMMANDS if re.match(r"milepost [a-z-]", line)})
MAKE = sorted({line.split()[1] for line in COMMANDS if re.match(r"make [a-z]", line)})
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
COMMANDS_BY_NAME = typer.main.get_group(app).commands


def table(heading: str) -> list[list[str]]:
    """The rows of all tables of a section."""
    section = README.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    return [row for row in rows if set("".join(row)) - set("- |")]


@pytest.mark.parametrize("line", MILEPOST)
def test_a_milepost_command_has_these_options(line: str) -> None:
    words = shlex.split(line)[1:]
    if words[0].startswith("--") or words[0] == "COMMAND":
        return
    command = COMMANDS_BY_NAME[words[0]]
    options = {name for parameter in command.params for name in parameter.opts}
    if words[0] == "inject" and len(words) > 2 and words[2] in KINDS:
        options |= {f"--{name.replace('_', '-')}" for name in KINDS[words[2]].options.model_fields}
    for word in words[1:]:
        if word.startswith("--") and word != "--help":
            assert word in options, line


def test_the_faults_that_it_names_are_those_of_the_table() -> None:
    section = README.split("\n## Sensors that lie\n")[1].split("\n## ")[0]
    named = {word for word in re.findall(r"`([a-z_]+)`", section) if word not in ("event", "full", "regional")}
    assert named == set(KINDS)


@pytest.mark.parametrize("target", MAKE)
def test_a_make_target_exists(target: str) -> None:
    assert target in TARGETS


def test_commands_are_found_in_the_text() -> None:
    assert {"milepost up", "milepost evaluate --all"} <= set(MILEPOST)
    assert {"up", "test", "test-fast"} <= set(MAKE)


def test_a_train_scenario_or_campaign_that_is_named_is_shipped() -> None:
    named = re.findall(r"--train ([a-z][a-z0-9-]*)", "\n".join(COMMANDS))
    for name in set(named) - {"mine"}:
        find_file(Path(name), "trains")
    scenarios = re.findall(r"(?:milepost evaluate|--scenario) ([a-z][a-z0-9-]*)", "\n".join(COMMANDS))
    for name in set(scenarios):
        find_file(Path(name), "scenarios")
    for name in re.findall(r"milepost campaign ([a-z][a-z0-9-]*)", "\n".join(COMMANDS)):
        find_file(Path(name), "campaigns")
    assert "metro" in named
    assert scenarios.count("loop-radar-balise") >= 2


@pytest.mark.parametrize("target", re.findall(r"\]\(([^)#]+)\)", README))
def test_a_link_into_the_tree_leads_to_a_file(target: str) -> None:
    assert target.startswith("https://") or (ROOT / target).is_file()


def first_cells(heading: str) -> set[str]:
    return {name for row in table(heading) for name in re.findall(r"`([^`]+)`", row[0])}


def test_tables_list_only_trains_campaigns_kinds_and_filters_that_exist() -> None:
    """A new one need not be listed to be used."""
    assert {"full", "metro"} <= first_cells("Trains") <= set(names_in("trains"))
    assert {"single-faults"} <= first_cells("Fault campaigns") <= set(names_in("campaigns"))
    assert {"odometer", "kalman"} <= first_cells("Sensors and filters") <= set(SENSORS) | set(FILTERS)


def test_every_stream_has_its_key_in_the_table() -> None:
    assert {row.key for row in STREAMS} <= first_cells("Keys and messages") | {"fix/{unit}"}


def test_packages_are_listed_from_top_to_bottom() -> None:
    listed = [re.findall(r"`([^`]+)`", row[0])[0] for row in table("Structure")[1:]]
    folders = {path.parent.name for path in (ROOT / "services/milepost").glob("*/__init__.py")}
    assert set(listed) == folders
    for number, name in enumerate(listed):
        for path in (ROOT / "services/milepost" / name).rglob("*.py"):
            above = rf"^(?:from|import) milepost\.({'|'.join(listed[:number]) or 'none'})\b"
            assert not re.search(above, path.read_text(encoding="utf-8"), re.M), path


def test_a_cell_of_measured_figures_holds_one_number() -> None:
    rows = [row for row in table("What was measured") if row[-1] != "measured"]
    assert len(rows) > 30
    for row in rows:
        assert len(re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", row[-1])) == 1, row
