"""docs/reference-commands.md: every command with its arguments and options, from what `--help` says."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

import typer

from .config_reference import cells

# typer brings its own copy of click, whose names are its own matter
Command = Any
Parameter = Any
HEAD = """\
# Every command

Made by `milepost schema` from the commands themselves; `milepost COMMAND --help` says the same. Exit codes: 0 done; 1 what the
command says of itself, or something failed; 2 a mistake on the command line or in a file.
"""
COLUMNS = "| option | values | default | meaning |\n| --- | --- | --- | --- |\n"
WORDS = {int: "whole number", float: "number", Path: "path", str: "text"}


def command_reference() -> str:
    """The whole document."""
    # imported here: the commands import this module when they are called
    from milepost.cli.main import app

    return HEAD + "".join(_group(typer.main.get_group(app), "milepost"))


def _group(group: Command, name: str) -> Iterator[str]:
    for word in sorted(group.commands):
        command = group.commands[word]
        if command.hidden:
            continue
        yield _section(command, f"{name} {word}")
        if hasattr(command, "commands"):
            yield from _group(command, f"{name} {word}")


def _section(command: Command, name: str) -> str:
    hints = get_type_hints(inspect.unwrap(command.callback)) if command.callback else {}
    rows = [_row(each, hints[each.name]) for each in command.params if each.name in hints and not each.hidden]
    table = f"\n{COLUMNS}{''.join(rows)}" if rows else ""
    return f"\n## {name}\n\n{_sentences(inspect.cleandoc(command.help or ''))}\n{table}"


def _row(parameter: Parameter, hint: Any) -> str:
    argument = parameter.param_type_name == "argument"
    shown = (getattr(parameter, "metavar", None) or parameter.name).upper() if argument else ", ".join(parameter.opts)
    default = "required" if parameter.required else _default(parameter)
    return cells(f"`{shown}`", _values(parameter, hint), default, _meaning(parameter))


def _values(parameter: Parameter, hint: Any) -> str:
    several = get_origin(hint) is list
    kinds = [each for each in get_args(hint) or (hint,) if each is not NoneType]
    if kinds == [bool]:
        return ""
    words = " or ".join(_word(each) for each in kinds)
    limits = [f"{sign} {limit:g}" for sign, limit in (("≥", parameter.min), ("≤", parameter.max)) if limit is not None]
    return f"{words} {', '.join(limits)}".strip() + (", repeatable" if several else "")


def _word(kind: Any) -> str:
    return ", ".join(f"`{each.value}`" for each in kind) if issubclass(kind, Enum) else WORDS[kind]


def _default(parameter: Parameter) -> str:
    value = parameter.default
    if value in (None, False, "", (), []):
        return ""
    value = value.value if isinstance(value, Enum) else value
    return f"`{', '.join(map(str, value)) if isinstance(value, list | tuple) else value}`"


def _meaning(parameter: Parameter) -> str:
    said = _sentences(getattr(parameter, "help", None) or "")
    variable = getattr(parameter, "envvar", None)
    return f"{said} From the environment: `{variable}`.".strip() if isinstance(variable, str) else said


def _sentences(text: str) -> str:
    """Line breaks within a paragraph are for terminals."""
    return "\n\n".join(re.sub(r"\s+", " ", part).strip() for part in text.split("\n\n"))
