"""Files of whole Zenoh configurations, as `--zenoh-config` and `run router --config` take them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import zenoh

from milepost.config.errors import ConfigError
from milepost.config.yaml_files import merged


def laid_over(config: dict[str, Any], path: Path) -> dict[str, Any]:
    """A configuration, changed by what a file says that is not Zenoh's default. Raises ConfigError."""
    return merged(config, _differing(whole(path), json.loads(str(zenoh.Config()))))


def whole(path: Path) -> dict[str, Any]:
    """A file as Zenoh reads it; certificates and keys that it names lie beside it. Raises ConfigError."""
    if not path.is_file():
        raise ConfigError(path, "", "no such file")
    try:
        out: dict[str, Any] = json.loads(str(zenoh.Config.from_file(str(path))))
    except zenoh.ZError as error:
        raise ConfigError(path, "", str(error).splitlines()[0]) from error
    tls = out["transport"]["link"]["tls"]
    for name, value in tls.items():
        if value and name.endswith(("_certificate", "_private_key")):
            tls[name] = str(path.absolute().parent / value)
            if not Path(tls[name]).is_file():
                raise ConfigError(path, f"transport.link.tls.{name}", f"{tls[name]}: no such file")
    return out


def _differing(config: dict[str, Any], default: dict[str, Any]) -> dict[str, Any]:
    out = {}
    for name, value in config.items():
        before = default.get(name)
        if isinstance(value, dict) and isinstance(before, dict):
            if below := _differing(value, before):
                out[name] = below
        elif value != before:
            out[name] = value
    return out
