"""Fleet files: several trains that one command starts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
    train file, as in a scenario. `external`: units whose sensors are programs of your own. `count`: so many trains of this
    kind, `name-1`, `name-2` and so on; the seeds of their worlds are that of the train file and those after it.
    """

    model_config = STRICT
    train: Annotated[Path, _named("trains")]
    name: Name | None = None
    line: Annotated[Path, _named("lines")] | None = None
    start_after_s: Annotated[float, Field(ge=0.0, le=86400.0)] = 0.0
    change: dict[str, Any] = Field(default_factory=dict)
    external: list[Name] = Field(default_factory=list)
    count: Annotated[int, Field(ge=1, le=10_000)] | None = None

    def changes(self) -> Iterator[dict[str, Any]]:
        """For each train, all that is different from its file. Raises ConfigError."""
        own = {"train": self.name, "line": None if self.line is None else str(self.line)}
        change = merged(self.change, {key: value for key, value in own.items() if value is not None})
        if self.count is None:
            yield change
            return
        like = load_train(self.train, change)
        for number in range(self.count):
            each = merged(change, {"train": f"{like.name}-{number + 1}"})
            if like.file.world is not None:
                each = merged(each, {"world": {"seed": like.file.world.seed + number}})
            yield each


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
    file, out, named = validate(path, read_yaml(path), FleetFile), list[Member](), dict[str, int]()
    for number, entry in enumerate(file.trains):
        for train, change in _trains(path, number, entry):
            check_external(train, entry.external, path, f"trains.{number}.external")
            if train.name in named:
                text = f"trains.{named[train.name]} is called {train.name} too; names must differ"
                raise ConfigError(path, f"trains.{number}.name", text)
            named[train.name] = number
            out.append(Member(train, entry.start_after_s, change, entry.external))
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


def _trains(path: Path, number: int, entry: MemberFile) -> Iterator[tuple[Train, dict[str, Any]]]:
    try:
        for change in entry.changes():
            yield load_train(entry.train, change), change
    except ConfigError as error:
        # without an error here the train is valid by itself, and the mistake is in the fleet file
        load_train(entry.train)
        raise ConfigError(path, f"trains.{number}", str(error)) from error
