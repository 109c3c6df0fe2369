"""`milepost schema`: all documents that are made from tables and models."""

from __future__ import annotations

import sys
from pathlib import Path

from milepost_schemas.asyncapi import asyncapi
from milepost_schemas.documents import json_schema_text, json_text, schema_names

from .documents.command_reference import command_reference
from .documents.config_models import FILES
from .documents.config_reference import config_reference
from .documents.config_schemas import config_schema
from .documents.event_reference import event_reference
from .documents.message_reference import message_reference

MESSAGES, CONFIG, ASYNCAPI = "schemas/json", "schemas/config", "schemas/asyncapi.json"
REFERENCES = {
    "docs/reference-configuration.md": config_reference,
    "docs/reference-messages.md": message_reference,
    "docs/reference-events.md": event_reference,
    "docs/reference-commands.md": command_reference,
}


def schema_files() -> dict[str, str]:
    """File name and content of the JSON Schema of every message."""
    return {f"{name}.schema.json": json_schema_text(name) for name in schema_names()}


def document_files() -> dict[str, str]:
    """Path and content of every document."""
    files = {f"{MESSAGES}/{name}": content for name, content in schema_files().items()}
    files |= {f"{CONFIG}/{kind}.schema.json": json_text(config_schema(kind)) for kind in FILES}
    return {**files, ASYNCAPI: json_text(asyncapi()), **{name: make() for name, make in REFERENCES.items()}}


def run_schema(out: Path, check: bool) -> int:
    """Write the files, or compare them."""
    differing = []
    for name, content in document_files().items():
        path = out / name
        if path.is_file() and path.read_text(encoding="utf-8") == content:
            continue
        differing.append(name)
        if not check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content, encoding="utf-8")
    for name in differing:
        print(f"{'differs' if check else 'written'}: {out / name}", file=sys.stderr)
    return 1 if check and differing else 0
