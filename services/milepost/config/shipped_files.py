"""Trains, scenarios and campaigns by name: first those in the working folder's `deploy`, then the shipped ones."""

from __future__ import annotations

import os
from difflib import get_close_matches
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]


def is_file(path: Path) -> bool:
    """Whether there is such a file; `Path.is_file` raises OSError for a name that no file can have."""
    return os.path.isfile(path)


def shipped_folder() -> Path:
    """The `deploy` folder of this installation: inside the wheel, or the repository's in an editable install."""
    inside = PACKAGE / "deploy"
    return inside if inside.is_dir() else PACKAGE.parents[1] / "deploy"


def names_in(kind: str) -> list[str]:
    """The names of all known `trains`, `scenarios` or `campaigns`, sorted."""
    return sorted({path.stem for folder in _folders(kind) for path in folder.glob("*.yaml")})


def find_file(given: Path, kind: str) -> Path:
    """A path as it is, or a bare name as the file `{kind}/{name}.yaml`; `kind` is `trains`, `scenarios` or `campaigns`.

    Raises ConfigError where a bare name is neither a file nor known.
    """
    if is_file(given) or given.suffix or len(given.parts) != 1:
        return given
    for folder in _folders(kind):
        path = folder / f"{given}.yaml"
        if is_file(path):
            return path
    # imported only here, because without it the command line starts faster
    from .yaml_files import ConfigError

    names = names_in(kind)
    near = get_close_matches(str(given), names, n=1)
    suggestion = f"; did you mean {near[0]!r}?" if near else ""
    raise ConfigError(given, "", f"neither a file nor one of the {kind}: {', '.join(names)}{suggestion}")


def named_in_file(given: str, folder: Path, kind: str) -> Path:
    """What a file in `folder` names: a path relative to the folder, or a bare name as `find_file` looks it up.

    Raises ConfigError where neither is there, with the nearest name.
    """
    path = folder / given
    if is_file(path):
        return path
    found = find_file(Path(given), kind)
    if is_file(found) and found != Path(given):
        return found
    from .mistakes import nearest
    from .yaml_files import ConfigError

    beside = sorted(other.name for other in path.parent.glob("*.yaml"))
    raise ConfigError(given, "", f"no such file{nearest(path.name, beside)}")


def scenario_folder() -> Path:
    """The folder of all scenarios: the working folder's `deploy/scenarios` if there is one, else the shipped one."""
    return next((folder for folder in _folders("scenarios") if folder.is_dir()), shipped_folder() / "scenarios")


def _folders(kind: str) -> tuple[Path, Path]:
    return Path("deploy") / kind, shipped_folder() / kind
