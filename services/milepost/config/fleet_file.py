"""Fleet files: several trains that one command starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field, ValidationInfo

from milepost.recordings.options import STRICT
from milepost_schemas.message import Name

from .mistakes import must_be_one_of
from .shipped_files import named_in_file
from .train import Train, load_train
from .yaml_files import ConfigError, merged, read_yaml, validate


def _named(kind: str) -> BeforeValidator:
    """A file by name or by a path relative to the fleet file."""

    def found(value: object, info: ValidationInfo) -> object:
        if not isinstance(value, str):
            return value
        try:
            return named_in_file(value, (info.context or {}).get("folder", Path()), kind).resolve()
        except ConfigError as error:
            raise ValueError(str(error)) from error

    return BeforeValidator(found)


class MemberFile(BaseModel):
    """One train of a fleet: a train file, and what is different from it.

    `name`: in keys, instead of the train file's. `start_after_s` of scenario time after the first one. `change`: laid over the
    train file, as in a scenario. `external`: units whose sensors are programs of your own.
    """

    model_config = STRICT
    train: Annotated[Path, _named("trains")]
    name: Name | None = None
    line: Annotated[Path, _named("lines")] | None = None
    start_after_s: Annotated[float, Field(ge=0.0, le=86400.0)] = 0.0
    change: dict[str, Any] = Field(default_factory=dict)
    external: list[Name] = Field(default_factory=list)

    @property
    def whole_change(self) -> dict[str, Any]:
        """All that is different from the train file."""
        own = {"train": self.name, "line": None if self.line is None else str(self.line)}
        return merged(self.change, {key: value for key, value in own.items() if value is not None})


class FleetFile(BaseModel):
    """A fleet: trains that run on one router, each under a name of its own."""

    model_config = STRICT
    fleet: Name
    about: str = ""
    trains: Annotated[list[MemberFile], Field(min_length=1)]


@dataclass(frozen=True)
class Member:
    """A train that is started with others; `change` is what is different from its file."""

    train: Train
    start_after_s: float = 0.0
    change: dict[str, Any] = field(default_factory=dict)
    external: Sequence[str] = ()


def load_fleet(path: Path) -> list[Member]:
    """The trains of a fleet file. Raises ConfigError, also for two of one name."""
    file, out = validate(path, read_yaml(path), FleetFile), list[Member]()
    for number, entry in enumerate(file.trains):
        train = _changed(path, number, entry)
        check_external(train, entry.external, path, f"trains.{number}.external")
        out.append(Member(train, entry.start_after_s, entry.whole_change, entry.external))
        for other, before in enumerate(out[:-1]):
            if before.train.name == out[-1].train.name:
                text = f"trains.{other} is called {before.train.name} too; names must differ"
                raise ConfigError(path, f"trains.{number}.name", text)
    return out


def load_together(paths: Sequence[Path], external: Sequence[str] = ()) -> list[Member]:
    """Trains by their files, each with these external units. Raises ConfigError, also for two of one name."""
    out: dict[str, Member] = {}
    for path in paths:
        train = load_train(path)
        if train.name in out:
            text = f"{out[train.name].train.path} and {path} are both called {train.name}; a fleet file can give other names"
            raise ConfigError("up", "--train", text)
        check_external(train, external, "up", "--external")
        out[train.name] = Member(train, external=external)
    return list(out.values())


def check_external(train: Train, external: Sequence[str], file: Path | str, place: str) -> None:
    """Whether these are units of a train. Raises ConfigError."""
    for unit in external:
        if unit not in train.sensors:
            raise ConfigError(file, place, must_be_one_of(train.sensors, unit))


def _changed(path: Path, number: int, entry: MemberFile) -> Train:
    try:
        return load_train(entry.train, entry.whole_change)
    except ConfigError as error:
        # without an error here the train is valid by itself, and the mistake is in the fleet file
        load_train(entry.train)
        raise ConfigError(path, f"trains.{number}", str(error)) from error
