"""`milepost schema`: the messages' JSON Schemas."""

from __future__ import annotations

import sys
from pathlib import Path

from milepost.recorder.rows import json_schema
from milepost_schemas import STREAMS


def schema_files() -> dict[str, str]:
    """File name and content of every message's JSON Schema."""
    files = {}
    for stream in STREAMS:
        files[f"{stream.message.SCHEMA}-{stream.message.VERSION}.schema.json"] = json_schema(stream.message)
    return files


def run_schema(out: Path, check: bool) -> int:
    """Write the files, or compare them."""
    differing = []
    for name, content in schema_files().items():
        path = out / name
        if path.is_file() and path.read_text(encoding="utf-8") == content:
            continue
        differing.append(name)
        if not check:
            out.mkdir(parents=True, exist_ok=True)
            path.write_text(content, encoding="utf-8")
    for name in differing:
        print(f"{'differs' if check else 'written'}: {out / name}", file=sys.stderr)
    return 1 if check and differing else 0
