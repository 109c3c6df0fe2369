"""`milepost chaos`: break a running train in every way of the matrix, and measure what outsiders see."""

from __future__ import annotations

import json
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from milepost.chaos.grid import tables
from milepost.chaos.matrix import Outcome, planned, run_matrix
from milepost.chaos.soak import soak
from milepost.chaos.text import HEAD, row, soak_text, summary
from milepost.config.errors import ConfigError


def run_chaos(train_file: Path, only: Sequence[str], as_json: bool, report: Path | None, show: bool) -> int:
    """Run the matrix and print it; 1 where a cell failed. Raises ConfigError."""
    if not all(only):
        raise ConfigError("chaos", "--only", "is empty")
    if not show:
        _check(report)
    wanted = planned(train_file, only)
    if not wanted:
        raise ConfigError("chaos", "--only", f"no cell matches {', '.join(only)}; --list shows all")
    if show:
        print(json.dumps([cell.name for cell in wanted]) if as_json else "\n".join(cell.name for cell in wanted))
        return 0
    _end_with_the_train()
    if not as_json:
        print(HEAD, flush=True)
    outcomes = run_matrix(train_file, wanted, _silent if as_json else _show)
    return _finish(outcomes, as_json, report)


def run_soak(train_file: Path, minutes: float, seed: int, only: Sequence[str], as_json: bool, report: Path | None) -> int:
    """Run a soak and print what came of it; 1 where something was not kept. Raises ConfigError."""
    if only:
        raise ConfigError("chaos", "--only", "names cells; a soak draws from all blows and lies")
    _check(report)
    _end_with_the_train()
    out = soak(train_file, minutes, seed, lambda text: print(f"milepost: {text}", file=sys.stderr, flush=True))
    text = json.dumps(out.as_dict())
    print(text if as_json else soak_text(out))
    if report is not None:
        (report / "soak.json").write_text(text + "\n", encoding="utf-8")
    return int(not out.passed)


def _check(report: Path | None) -> None:
    """Whether results can be written, before a train is broken for a quarter of an hour."""
    if report is None:
        return
    if report.exists() and not report.is_dir():
        raise ConfigError(report, "", "is not a folder")
    try:
        report.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=report):
            pass
    except OSError as error:
        raise ConfigError(report, "", f"cannot be written to: {error.strerror}") from error


def _end_with_the_train() -> None:
    """The train that is running ends with this process, also where that is asked to end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))


def _show(outcome: Outcome) -> None:
    print(row(outcome), flush=True)


def _silent(outcome: Outcome) -> None:
    # the answer is one JSON value; what has been done meanwhile is progress
    print(f"milepost: {outcome.cell.name}: {'passed' if outcome.passed else 'failed'}", file=sys.stderr, flush=True)


def _finish(outcomes: list[Outcome], as_json: bool, report: Path | None) -> int:
    found = [outcome.as_dict() for outcome in outcomes]
    print(json.dumps(found) if as_json else summary(outcomes))
    if report is not None:
        (report / "results.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
        lines = [HEAD, *(row(outcome) for outcome in outcomes), summary(outcomes)]
        (report / "matrix.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
        (report / "matrix.md").write_text(tables(outcomes), encoding="utf-8")
    return int(any(not outcome.passed for outcome in outcomes))
