"""Tables of kinds: our own, and those that other distributions register as entry points."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any, Generic, TypeVar

K = TypeVar("K")


class KindError(Exception):
    """A kind of another distribution that cannot be used; one line that names the distribution and its entry."""


class Kinds(Mapping[str, K], Generic[K]):
    """Kinds by name: `ours`, then those of the entry point `group`, by name.

    The names of a group are looked up when the table is first used, and a kind is imported when it is first asked for: one
    that is broken stops only who wants it. `base`: the class that a kind derives from; `mistake` says what else is wrong with
    one. Raises KindError for a kind that cannot be used, and at first use for a name that is taken.
    """

    def __init__(self, group: str, base: type, ours: Iterable[Any], mistake: Callable[[Any], str]) -> None:
        self._group, self._base, self._mistake = group, base, mistake
        self._ours: dict[str, K] = {kind.kind: kind for kind in ours}
        self._loaded: dict[str, K] = {}

    def __getitem__(self, name: str) -> K:
        """A kind by its name."""
        entry = self._registered.get(name)
        if entry is None:
            return self._ours[name]
        if name not in self._loaded:
            self._loaded[name] = self._load(entry)
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        """Whether there is such a kind; it is not imported for that."""
        return name in self._ours or name in self._registered

    def __iter__(self) -> Iterator[str]:
        """The names."""
        return iter((*self._ours, *self._registered))

    def __len__(self) -> int:
        """How many kinds there are."""
        return len(self._ours) + len(self._registered)

    @property
    def elsewhere(self) -> list[str]:
        """The kinds of other distributions, with version and place."""
        return [f"{name} {entry.dist and entry.dist.version} {_place(entry)}" for name, entry in self._registered.items()]

    @cached_property
    def _registered(self) -> dict[str, Any]:
        """The entries by name."""
        from importlib.metadata import entry_points  # slow to import

        found: dict[str, Any] = {}
        for entry in sorted(entry_points(group=self._group), key=lambda entry: (entry.name, _distribution(entry))):
            if entry.name in self._ours:
                raise KindError(f"{_place(entry)}: the name is taken by Milepost's own {entry.name}")
            if entry.name in found:
                raise KindError(f"{_place(entry)}: the name is taken by {_distribution(found[entry.name])}")
            found[entry.name] = entry
        return found

    def _load(self, entry: Any) -> K:
        try:
            kind = entry.load()
        except Exception as error:  # whatever somebody else's module does when it is imported
            raise KindError(" ".join(f"{_place(entry)}: {type(error).__name__}: {error}".split())) from error
        mistake = self._mistake_of(kind, entry.name)
        if mistake:
            raise KindError(f"{_place(entry)}: {mistake}")
        loaded: K = kind
        return loaded

    def _mistake_of(self, kind: Any, name: str) -> str:
        if self._base not in getattr(kind, "__mro__", ()):
            return f"not a subclass of {self._base.__module__}.{self._base.__qualname__}"
        for needed in ("kind", "options_model"):
            if not hasattr(kind, needed):
                return f"it has no `{needed}`"
        if kind.kind != name:
            return f"its `kind` is {kind.kind!r}, which must be the entry's name"
        if inspect.isabstract(kind):
            return f"it does not define {', '.join(sorted(kind.__abstractmethods__))}"
        return self._mistake(kind)


def _distribution(entry: Any) -> str:
    return entry.dist.name if entry.dist is not None else "an unknown distribution"


def _place(entry: Any) -> str:
    return f"{_distribution(entry)}: entry point {entry.group}: {entry.name} = {entry.value}"
