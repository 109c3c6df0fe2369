"""The one error of configuration files. It imports nothing heavy: the command line needs it before anything is loaded."""

from __future__ import annotations

from pathlib import Path


class ConfigError(Exception):
    """A configuration that cannot be used: `file: field: what is wrong`."""

    def __init__(self, file: Path | str, field: str, text: str) -> None:
        place = f"{file}: {field}" if field else f"{file}"
        super().__init__(" ".join(f"{place}: {text}".splitlines()))
        self._parts = file, field, text

    def __reduce__(self) -> tuple[type[ConfigError], tuple[Path | str, str, str]]:
        """Another process may have found the mistake."""
        return ConfigError, self._parts
