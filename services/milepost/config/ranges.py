"""The numbers that an option may have, in words, from its JSON Schema."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

LIMITS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def limits_of(schema: Mapping[str, Any]) -> dict[str, float]:
    """The limits of a value, of one that may be absent too, by their names in JSON Schema."""
    inside = [schema, *schema.get("anyOf", ())]
    return {name: each[name] for each in inside for name in LIMITS if name in each}


def range_of(schema: Mapping[str, Any]) -> str:
    """`> 0`, `≥ -1, < 0`; empty where there is no limit."""
    return ", ".join(f"{LIMITS[name]} {limit:g}" for name, limit in limits_of(schema).items())
