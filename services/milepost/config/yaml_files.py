"""YAML files are read strictly: a mistake is reported in one line that names file and field."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.dataclasses import dataclass as pydantic_dataclass

from .errors import ConfigError as ConfigError
from .mistakes import first_mistake, text_of

# a few lines of anchors can stand for millions of values
MOST_VALUES = 1_000_000
NO_TEXT = "a text with half of a surrogate pair"
M = TypeVar("M", bound=BaseModel)
D = TypeVar("D")


class _Loader(yaml.SafeLoader):
    """Reads YAML 1.2's floats (1e-6 is a number), refuses duplicate keys, and anchors that contain themselves or too much."""

    def construct_document(self, node: yaml.Node) -> Any:
        self._count(node, {})
        return super().construct_document(node)

    def _count(self, node: yaml.Node, counts: dict[int, int]) -> int:
        """How many values a node stands for, with all that its aliases repeat."""
        if isinstance(node, yaml.ScalarNode):
            return 1
        known = counts.get(id(node))
        if known is None:
            counts[id(node)] = 0
            pairs = isinstance(node, yaml.MappingNode)
            inside = [each for pair in node.value for each in pair] if pairs else node.value
            known = counts[id(node)] = 1 + sum(self._count(each, counts) for each in inside)
        elif known == 0:
            raise yaml.constructor.ConstructorError(None, None, "an anchor contains itself", node.start_mark)
        if known > MOST_VALUES:
            text = f"aliases make more than {MOST_VALUES} values of it"
            raise yaml.constructor.ConstructorError(None, None, text, node.start_mark)
        return known

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[object] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                raise yaml.constructor.ConstructorError(None, None, "a key cannot be a list or a mapping", key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"duplicate key {key!r}", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"^[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789"))


def read_yaml(path: Path) -> dict[str, Any]:
    """A YAML file's mapping. Raises ConfigError."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(path, "", error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise ConfigError(path, "", "not UTF-8 text") from error
    try:
        # _Loader is a SafeLoader
        content = yaml.load(text, Loader=_Loader)  # nosec B506
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ConfigError(path, line, error.problem or "not YAML") from error
    except yaml.YAMLError as error:
        raise ConfigError(path, "", " ".join(str(error).split())) from error
    except (ValueError, OverflowError, RecursionError) as error:  # an invalid date or number; too many nested brackets
        raise ConfigError(path, "", f"not YAML: {error}") from error
    if not isinstance(content, dict):
        raise ConfigError(path, "", "not a mapping")
    return content


def validate(path: Path, content: Mapping[str, Any], model: type[M], prefix: str = "") -> M:
    """A mapping as a model; paths in it are relative to the file's folder. Raises ConfigError for the first mistake."""
    try:
        return model.model_validate(content, context={"folder": path.parent})
    except ValidationError as error:
        first = first_mistake(error.errors(include_url=False), model)
        field = ".".join([*([prefix] if prefix else []), *_place(content, first["loc"], first["type"] == "missing")])
        raise ConfigError(path, field, text_of(first, model)) from error
    except UnicodeEncodeError as error:
        raise ConfigError(path, prefix, NO_TEXT) from error


def validate_dataclass(path: Path, content: Mapping[str, Any], kind: type[D], field: str) -> D:
    """A mapping as a frozen dataclass of plain numbers and texts. Raises ConfigError for the first mistake."""
    checked: Any = pydantic_dataclass(kind, frozen=True, config=ConfigDict(strict=True, extra="forbid", allow_inf_nan=True))
    try:
        options: D = checked(**content)
        return options
    except ValidationError as error:
        first = first_mistake(error.errors(include_url=False), kind)
        raise ConfigError(path, ".".join([field, *(str(part) for part in first["loc"])]), text_of(first, kind)) from error
    except UnicodeEncodeError as error:
        raise ConfigError(path, field, NO_TEXT) from error


def _place(content: Any, loc: Sequence[int | str], missing: bool) -> list[str]:
    """The place of an error in the file: pydantic's place without the tags of union members, which are not in the file."""
    out = []
    for number, part in enumerate(loc, start=1):
        inside = part in content if isinstance(content, Mapping) else isinstance(content, list) and isinstance(part, int)
        if inside:
            content = content[part]
        elif not (missing and number == len(loc)):
            continue
        out.append(str(part))
    return out


def merged(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with `change` laid over it, mapping by mapping."""
    out = dict(base)
    for key, value in change.items():
        old = out.get(key)
        out[key] = merged(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return out
