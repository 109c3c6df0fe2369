"""The error of configuration files. This module imports nothing slow: the command line needs it at once."""

from __future__ import annotations

from pathlib import Path


class ConfigError(Exception):
    """A mistake in a configuration file; its text is `file: field: what is wrong`, in one line."""

    def __init__(self, file: Path | str, field: str, text: str) -> None:
        place = f"{file}: {field}" if field else f"{file}"
        super().__init__(" ".join(f"{place}: {text}".splitlines()))
        self._parts = file, field, text

    def __reduce__(self) -> tuple[type[ConfigError], tuple[Path | str, str, str]]:
        """Allow the error to be raised in another process."""
        return ConfigError, self._parts
