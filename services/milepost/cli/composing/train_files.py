"""The files that a train is made of, and where its containers have them: each at the same place as seen from the others."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from milepost.config.line_file import LineFile
from milepost.config.train import Train
from milepost.config.yaml_files import read_yaml, validate

# where a train's files are in its containers; a file that is named by its whole path is there by this path
FOLDER = PurePosixPath("/srv/milepost")
Place = tuple[int | str, ...]


@dataclass(frozen=True)
class Mounted:
    """A file of this machine, and where containers have it."""

    source: Path
    target: PurePosixPath


@dataclass(frozen=True)
class TrainFiles:
    """All files of a train. Not their folders: those may hold what containers must not read, such as keys."""

    train: Mounted
    line: Mounted
    others: tuple[Mounted, ...]

    @property
    def all(self) -> list[Mounted]:
        """Each file once."""
        return list({each.target: each for each in (self.train, self.line, *self.others)}.values())


def train_files(train: Train) -> TrainFiles:
    """The files of a train, its line's and its recordings among them. Raises ConfigError."""
    raw = read_yaml(train.path)
    # a table of shares warns that it is no other kind of shares
    own = list(_paths(train.file.model_dump(exclude={"units"}, warnings=False), raw))
    for unit, sensor in train.sensors.items():
        own += _paths(sensor.options.model_dump(), raw["units"][unit])
    line = next(os.path.normpath(written) for place, written, _ in own if place == ("line",))
    raw_line = read_yaml(train.file.line)
    of_line = _paths(validate(train.file.line, raw_line, LineFile).model_dump(), raw_line)
    found = {os.path.normpath(written): source for _, written, source in own}
    found |= {os.path.normpath(os.path.join(os.path.dirname(line), written)): source for _, written, source in of_line}
    folder = _folder(train.path, found)

    def mounted(written: str) -> Mounted:
        return Mounted(found[written], PurePosixPath(os.path.normpath(folder / written)))

    itself = Mounted(Path(os.path.abspath(train.path)), folder / train.path.name)
    return TrainFiles(itself, mounted(line), tuple(mounted(written) for written in found if written != line))


def _folder(train_file: Path, named: Mapping[str, Path]) -> PurePosixPath:
    """The train file's folder in containers: as deep as files beside and above it need."""
    up = max((written.split(os.sep).count("..") for written in named), default=0)
    # a file system's root is above itself, which is no name
    parts = ["_"] * up + list(Path(os.path.abspath(train_file)).parent.parts[1:])
    return FOLDER.joinpath(*parts[len(parts) - up :])


def _paths(values: Any, raw: Any, place: Place = ()) -> Iterator[tuple[Place, str, Path]]:
    """Each path in a model's values: its place, how the file writes it, and what it leads to."""
    if isinstance(values, Path):
        yield place, str(raw), values
        return
    rows = values.items() if isinstance(values, Mapping) else enumerate(values) if isinstance(values, list | tuple) else ()
    for key, value in rows:
        inside = (isinstance(raw, Mapping) and key in raw) or (isinstance(raw, Sequence) and not isinstance(raw, str))
        # where a mapping is written as a word, that is its path
        yield from _paths(value, raw[key] if inside else raw, (*place, key))
