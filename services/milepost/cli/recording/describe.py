"""`milepost info` and `milepost export`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from milepost.config.errors import ConfigError
from milepost.recorder.library import need_mcap, need_parquet

from ..showing.progress import progress_bar

if TYPE_CHECKING:
    from milepost.recorder.summary import Summary

MIB = 1 << 20
SHOWN_GAPS, SHOWN_UNITS = 3, 7


def run_info(recording: Path, as_json: bool) -> int:
    """Print what is in a recording; 1 if nothing is. Raises ConfigError."""
    need_mcap("info")
    from milepost.recorder.reading import recordings_in
    from milepost.recorder.summary import Summary

    files = recordings_in(recording)
    with progress_bar("reading", sum(file.stat().st_size for file in files)) as show:
        summary = Summary().read(files, show)
    if as_json:
        print(json.dumps(summary.as_dict(), indent=2))
    else:
        _print(summary)
    return 0 if summary.streams else 1


def _print(summary: Summary) -> None:
    from datetime import UTC, datetime

    found = summary.as_dict()
    for file in found["files"]:
        state = "damaged" if file["damaged"] else "whole" if file["whole"] else "cut off: read as far as it goes"
        print(f"{file['file']}: {file['bytes'] / MIB:.1f} MiB, {state}")
        for damage in file["damaged"]:
            print(f"  damaged: {damage}")
    if not found["messages"]:
        print("no messages")
        return
    begin = datetime.fromtimestamp(found["begin_ns"] * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    print(f"{', '.join(found['trains'])}: {found['messages']} messages in {found['span_s']:.1f} s from {begin} UTC")
    print(f"{'train':16} {'stream':18} {'messages':>9} {'per second':>10} {'KiB':>9} {'missing':>8}  units")
    span_s = found["span_s"]
    for row in found["streams"]:
        # messages of one moment have no rate
        rate, kib = f"{row['messages'] / span_s:.1f}" if span_s > 0.0 else "-", row["bytes"] / 1024
        head = f"{row['train']:16} {row['stream']:18} {row['messages']:9} {rate:>10} {kib:9.0f} {row['missing']:8}"
        print(f"{head}  {_some(row['units'])}".rstrip())
    for sender in found["senders"]:
        if sender["missing"] or sender["repeated"]:
            print(_gaps(sender))


def _some(units: list[str]) -> str:
    more = len(units) - SHOWN_UNITS
    return ", ".join(units[:SHOWN_UNITS]) + (f" and {more} more" if more > 0 else "")


def _gaps(sender: dict[str, Any]) -> str:
    numbers = ", ".join(f"{low}" if low == high else f"{low} to {high}" for low, high in sender["gaps"][:SHOWN_GAPS])
    more = ", ..." if len(sender["gaps"]) > SHOWN_GAPS else ""
    who = " ".join(word for word in (sender["train"], sender["stream"], sender["unit"]) if word)
    text = f"{who} ({sender['instance']}): {sender['missing']} of {sender['last'] - sender['first'] + 1} missing"
    if numbers:
        text += f": sequence {numbers}{more}"
    return text + (f"; {sender['repeated']} came again" if sender["repeated"] else "")


def run_export(
    recording: Path,
    csv: Path | None,
    parquet: Path | None,
    foxglove: Path | None,
    since: str | None = None,
    until: str | None = None,
) -> int:
    """Write a recording, or a part of it, in the formats asked for; 1 if there is nothing in it. Raises ConfigError."""
    if csv is None and parquet is None and foxglove is None:
        raise ConfigError("export", "", "say what to write: --csv, --parquet or --foxglove")
    need_mcap("export")
    if parquet is not None:
        need_parquet("export --parquet")
    from milepost.recorder.export import export, outputs
    from milepost.recorder.reading import SUFFIX, recordings_in
    from milepost.recorder.window import outside, window_of

    files = recordings_in(recording)
    window = window_of(files, since, until)
    if foxglove is not None and foxglove.suffix == SUFFIX and foxglove.resolve().parent == recording.resolve():
        raise ConfigError(foxglove, "", "would be read as a part of the recording: name a file elsewhere for --foxglove")
    size = sum(file.stat().st_size for file in files)
    with progress_bar("exporting", size) as show, outputs(csv, parquet, foxglove, files) as writers:
        done = export(files, writers, show, window)
    for line in done.lines:
        print(line, file=sys.stderr)
    if not done.messages and (said := outside(files, window)):
        print(f"milepost: {said}", file=sys.stderr)
    return 0 if done.messages else 1
