"""What all options of a configuration file have in common: strictness, paths meant from the file's folder, spans."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, ValidationInfo

STRICT = ConfigDict(strict=True, frozen=True, extra="forbid", allow_inf_nan=False)


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
