"""The text for a mistake that pydantic found: what is wrong, the value in the file, and the nearest known word."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from milepost.recordings.options import nearest as nearest
from milepost_schemas.message import NAME_PATTERN

UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
LONGEST_VALUE = 60


def must_be_one_of(known: Iterable[str], value: object) -> str:
    """`must be one of a, b, not 'x'`, with the nearest known word."""
    known = list(known)
    return f"must be one of {', '.join(known)}, not {_abbreviated(value)}{nearest(value, known)}"


def one_of(known: Iterable[str], word: str) -> str:
    """For a word of the command line: `must be one of a, b, not 'x'`, or `required: one of a, b` where there is none."""
    return must_be_one_of(known, word) if word else f"required: one of {', '.join(known)}"


def first_mistake(errors: list[ErrorDetails], model: type) -> ErrorDetails:
    """The mistake to report: for a missing key, an unknown key beside it that resembles a known one, else the first mistake."""
    first = errors[0]
    beside = [e for e in errors if e["type"] in UNKNOWN_KEY and e["loc"][:-1] == first["loc"][:-1]]
    if first["type"] == "missing":
        return next((e for e in beside if nearest(e["loc"][-1], known_keys(model, e["loc"]))), first)
    return first


def text_of(mistake: ErrorDetails, model: type) -> str:
    """What is wrong, with the value and, for words, the nearest known word."""
    kind, context, value = mistake["type"], mistake.get("ctx", {}), mistake["input"]
    if kind in UNKNOWN_KEY:
        known = known_keys(model, mistake["loc"])
        if not known:
            return "unknown key; none is known here"
        return "unknown key" + (nearest(mistake["loc"][-1], known) or f"; known keys: {', '.join(known)}")
    if kind == "union_tag_invalid":
        words = [word.strip("'") for word in context["expected_tags"].split(", ")]
        return f"{context['discriminator'].strip(chr(39))} {must_be_one_of(words, context['tag'])}"
    if kind == "literal_error":
        words = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
        return must_be_one_of(words, value)
    text = mistake["msg"].removeprefix("Value error, ")
    if kind == "string_pattern_mismatch" and context["pattern"] == NAME_PATTERN:
        text = "must be 1 to 63 lower-case letters, digits, '_', '.' or '-', and begin with a letter or a digit"
    # for a whole mapping or list the text names the wrong field already
    if kind == "missing" or (kind == "value_error" and isinstance(value, Mapping | list)) or _abbreviated(value) in text:
        return text
    if isinstance(value, str) and text.startswith(f"{value}: "):
        return text
    return f"{text}, not {_abbreviated(value)}"


def _abbreviated(value: object) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


def known_keys(model: type, place: tuple[int | str, ...]) -> list[str]:
    """The keys that are allowed in the mapping at `place[:-1]`, in the order of the model."""
    here = [model]
    for part in place[:-1]:
        inside = [found for one in here for found in _models(_annotations(one).get(str(part)))]
        # a part that is no field is an index, a key of a mapping, or the tag of a union's member, which pydantic adds
        here = inside or [one for one in here if _has_tag(one, part)] or here
    return list(dict.fromkeys(name for one in here for name in _annotations(one)))


def _annotations(model: type) -> dict[str, Any]:
    if issubclass(model, BaseModel):
        return {name: field.annotation for name, field in model.model_fields.items()}
    return {field.name: field.type for field in fields(model)} if is_dataclass(model) else {}


def _models(annotation: Any) -> list[type]:
    """The models anywhere inside an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in get_args(annotation) for found in _models(part)]


def _has_tag(model: type, tag: object) -> bool:
    return any(get_origin(a) is Literal and tag in get_args(a) for a in _annotations(model).values())
