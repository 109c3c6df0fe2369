"""Fingerprints of train files and of the code: a result is taken again only where both are the same."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import milepost_schemas
from milepost.config.shipped_files import PACKAGE
from milepost.config.yaml_files import read_yaml
from milepost.estimation.filters import FILTERS
from milepost.sensors import SENSORS

# the packages on which the figures of a run do not depend; of this one they depend on what measures
ABOVE = ("cli", "campaign", "chaos", "evaluation", "checks", "runtime", "security", "deploy")
MEASURING = ("measure.py", "watch.py")
# another minor version of Python may round otherwise: `sum` of floats does since 3.12
PYTHON = sys.version_info[:2]
DIGITS = 16


def digest(content: Any) -> str:
    """A short hash of what JSON can say."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


@cache
def code_fingerprint() -> str:
    """A hash of the source files on which a run's figures depend, and of the versions of Python, numpy and kinds elsewhere."""
    whole = hashlib.sha256(f"{PYTHON} {np.__version__}".encode())
    for name, path in _sources():
        whole.update(name.encode() + b"\0" + path.read_bytes())
    for kind in (*SENSORS.elsewhere, *FILTERS.elsewhere):
        whole.update(kind.encode())
    return whole.hexdigest()[:DIGITS]


def _sources() -> Iterator[tuple[str, Path]]:
    rooms = sorted(folder for folder in PACKAGE.iterdir() if folder.is_dir() and folder.name not in ABOVE)
    for folder in (*rooms, Path(milepost_schemas.__file__).parent):
        yield from ((f"{folder.name}/{path.relative_to(folder)}", path) for path in sorted(folder.rglob("*.py")))
    yield from ((name, Path(__file__).with_name(name)) for name in MEASURING)


@cache
def train_fingerprint(path: Path) -> str:
    """A hash of a train file and of every file that it names: line, geometry, recordings. Raises ConfigError."""
    whole = hashlib.sha256()
    for file in _files(path.resolve()):
        whole.update(file.read_bytes())
    return whole.hexdigest()[:DIGITS]


def _files(path: Path) -> Iterator[Path]:
    yield path
    if path.suffix == ".yaml":
        for text in _texts(read_yaml(path)):
            named = path.parent / text
            if named != path and len(text) < 1000 and named.is_file():
                yield from _files(named)


def _texts(content: Any) -> Iterator[str]:
    if isinstance(content, str) and content and "\0" not in content:
        yield content
    elif isinstance(content, dict):
        for value in content.values():
            yield from _texts(value)
    elif isinstance(content, list):
        for value in content:
            yield from _texts(value)
