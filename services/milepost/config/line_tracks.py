"""The lines that trains say they are on, and their geometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from milepost.track.line import Line
from milepost.track.track import Track

from .line_file import load_line
from .shipped_files import find_file, names_in
from .yaml_files import ConfigError

MOST_LINES = 64


class KnownLines:
    """Lines by name and content hash: of given files, else of a line file of that name where there is one.

    `tell` hears why there is none. Files are read once, when a train on their line is first seen.
    """

    def __init__(self, files: Sequence[Path] = (), tell: Callable[[str], None] = lambda sentence: None) -> None:  # noqa: ARG005
        self._known: dict[tuple[str, str], Line | None] = {}
        self._tell = tell
        for file in files:
            self._load(file)

    def __call__(self, name: str, content_hash: str) -> Line | None:
        """A line; None where its file is not known or is another one."""
        key = (name, content_hash)
        # names come from whoever publishes: no other files than these, and not without end
        if key not in self._known and len(self._known) < MOST_LINES:
            self._known[key] = None
            try:
                if name in names_in("lines"):
                    self._load(find_file(Path(name), "lines"))
            except ConfigError as error:
                self._tell(f"no geometry of line {name}: {error}")
            if self._known[key] is None:
                self._tell(f"no geometry of line {name} ({content_hash}): no line file in deploy/lines or --line is this line")
        return self._known.get(key)

    def _load(self, file: Path) -> None:
        line = load_line(file)
        self._known[line.name, line.content_hash] = line


class LineTracks:
    """The tracks of lines, by name and content hash; see `KnownLines`."""

    def __init__(self, files: Sequence[Path] = (), tell: Callable[[str], None] = lambda sentence: None) -> None:  # noqa: ARG005
        self._lines = KnownLines(files, tell)

    def __call__(self, name: str, content_hash: str) -> Track | None:
        """The track of a line; None where its file is not known, is another one, or has no geometry."""
        line = self._lines(name, content_hash)
        return None if line is None else line.track
