"""`milepost rerun`: recorded messages through the same nodes."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from milepost.config.fusion_settings import fingerprint
from milepost.config.scenario_file import load_scenario
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError
from milepost.offline.message_log import Reader
from milepost.offline.run import replay
from milepost_schemas import FusedState

from ..showing.progress import progress_bar

ORIGINS = {"readings": ("reading",), "estimates": ("estimate", "fix")}


def run_rerun(readings: Path, train_file: Path, scenario: Path | None, out: Path, origin: str) -> int:
    """Write the settled states of a recording; 1 if there are none. Raises ConfigError for files that cannot be used."""
    if origin not in ORIGINS:
        raise ConfigError("rerun", "--from", f"must be one of {', '.join(ORIGINS)}, not {origin!r}")
    if not readings.exists():
        raise ConfigError(readings, "", "no such file")
    if not out.parent.is_dir():
        raise ConfigError(out, "", "its folder does not exist")
    if out.is_dir():
        raise ConfigError(out, "", "is a folder")
    train = load_train(train_file) if scenario is None else load_scenario(scenario)[1]
    reader = Reader(readings, train, ORIGINS[origin])
    begun, count, first, last = time.perf_counter(), 0, 0, 0
    partial = out.with_name(out.name + ".partial")
    try:
        with partial.open("w", encoding="utf-8") as file, progress_bar("rerun", reader.size) as show:

            def settled(state: FusedState) -> None:
                nonlocal count, first, last
                file.write(state.model_dump_json() + "\n")
                count, first, last = count + 1, first or state.measured_at_ns, state.measured_at_ns
                if count % 50 == 0:
                    show(reader.read_bytes)

            replay(train, reader.messages(), origin == "estimates", settled)
        if count:
            partial.replace(out)
    finally:
        # an interrupted rerun leaves nothing half written, and what was there before as it was
        partial.unlink(missing_ok=True)
    spent = time.perf_counter() - begun
    if count:
        print(f"{count} states of {(last - first) * 1e-9:.1f} s in {spent:.1f} s -> {out}", file=sys.stderr)
    else:
        print(f"milepost: {readings}: no state came of it; nothing was written", file=sys.stderr)
    for reason, number in reader.refusals.counts.items():
        print(f"refused {number} as {reason}; first: {reader.first[reason]}", file=sys.stderr)
    for path in reader.cut_off():
        print(f"{path}: cut off: read as far as it goes", file=sys.stderr)
    for path in reader.made_otherwise(fingerprint(train)):
        print(f"{path}: recorded with other settings, or another version: its states may have been others", file=sys.stderr)
    return 0 if count else 1
