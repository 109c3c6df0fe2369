"""The library for MCAP files, or one line that says how to get it."""

from __future__ import annotations

from importlib import import_module

from milepost.config.errors import ConfigError

HOW = "needs the extra `record` (pip install 'milepost[record]')"
HOW_PARQUET = "needs the extra `parquet` (pip install 'milepost[parquet]')"


def need_mcap(what: str) -> None:
    """Raise ConfigError where MCAP files cannot be written or read. `what`: the command or file that needs it."""
    _need(what, ("mcap.writer", "zstandard"), HOW)


def need_parquet(what: str) -> None:
    """Raise ConfigError where Parquet files cannot be written."""
    _need(what, ("pyarrow.parquet",), HOW_PARQUET)


def _need(what: str, modules: tuple[str, ...], how: str) -> None:
    for module in modules:
        try:
            import_module(module)
        except ImportError as error:
            raise ConfigError(what, "", f"{how}: {error}") from error
