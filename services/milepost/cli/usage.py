"""A mistake on the command line, in one line that says what to give."""

from __future__ import annotations

import re
from typing import Any

import typer

# typer brings its own copy of click, whose names are its own matter
UsageError: Any = typer.BadParameter.__mro__[1]


def usage_line(error: Any) -> str:
    """What is wrong and where to read more: `campaign: FILE: required: campaign file, or ...; see milepost campaign --help`."""
    context, parameter = error.ctx, getattr(error, "param", None)
    words = context.command_path.split()[1:] if context is not None else []
    if type(error).__name__ == "MissingParameter" and parameter is not None:
        text = f"{_name(parameter)}: required{_purpose(parameter)}"
    else:
        text = " ".join(error.format_message().split()).rstrip(".")
        text += _meant_train(context, text)
    return f"{': '.join([*words, text])}; see `{' '.join(['milepost', *words])} --help`"


def _name(parameter: Any) -> str:
    """An option as it is typed, an argument in capitals."""
    return str(parameter.opts[0]) if parameter.param_type_name == "option" else str(parameter.name).upper()


def _purpose(parameter: Any) -> str:
    help_text = str(getattr(parameter, "help", None) or "").rstrip(".")
    return f": {help_text[0].lower()}{help_text[1:]}" if help_text else ""


def _meant_train(context: Any, text: str) -> str:
    """Every command takes its train by `--train`: a word too many may have been one."""
    extra = re.fullmatch(r"Got unexpected extra argument(?:\(s\))? \((\S+)\)", text)
    takes_train = context is not None and any("--train" in each.opts for each in context.command.params)
    return f"; did you mean `--train {extra[1]}`?" if extra and takes_train else ""
