"""Options that several commands share, and what the shell completes in them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from milepost.config.shipped_files import find_file, names_in


def train_file(given: Path) -> Path:
    """A train file, by its path or its name. Raises ConfigError."""
    return find_file(given, "trains")


def _complete(kind: str, typed: str) -> list[str]:
    """Names for the shell; it falls back to file names where there are none."""
    return [name for name in names_in(kind) if name.startswith(typed)]


def _complete_train(incomplete: str) -> list[str]:
    return _complete("trains", incomplete)


def complete_scenario(incomplete: str) -> list[str]:
    """Names of scenarios for the shell."""
    return _complete("scenarios", incomplete)


TrainOption = Annotated[
    Path,
    typer.Option(
        "--train",
        autocompletion=_complete_train,
        help="Train file, or the name of one: looked up in ./deploy/trains, then among those shipped with Milepost.",
    ),
]
ConnectOption = Annotated[
    list[str],
    typer.Option(
        "--connect", envvar="MILEPOST_CONNECT", help="Endpoint of the router. Repeat the option to name others for failover."
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
StateDirOption = Annotated[
    Path | None,
    typer.Option(
        "--state-dir", envvar="MILEPOST_STATE_DIR", help="Folder in which filters keep their calibration between runs."
    ),
]
