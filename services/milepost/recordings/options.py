"""What all options of a configuration file have in common: strictness, paths meant from the file's folder, spans."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, ValidationInfo

STRICT = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


def nearest(word: object, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` with the nearest known word; empty where no known word is similar."""
    found = get_close_matches(str(word), list(known), n=1)
    return f"; did you mean {found[0]!r}?" if found else ""


def resolve(value: object, info: ValidationInfo) -> object:
    """A path is meant from the folder of the file that names it."""
    if isinstance(value, str):
        base = (info.context or {}).get("folder", Path())
        return (Path(base) / value).resolve()
    return value


DataPath = Annotated[Path, BeforeValidator(resolve)]


def _forward(span: list[float]) -> list[float]:
    if span[0] >= span[1]:
        raise ValueError("a span [from, to) must end after it begins")
    return span


Span = Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_forward)]
