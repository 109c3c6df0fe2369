"""`milepost run`: one process."""

from __future__ import annotations

import json
from pathlib import Path

from milepost.config.errors import ConfigError
from milepost.runtime.launch import end_with_parent
from milepost.runtime.zenoh_config import Connection


def run_role(
    role: str,
    unit: str,
    train_file: Path,
    connection: Connection,
    listen: list[str],
    link: list[str],
    config: Path | None,
    speed: float,
    duration: float | None,
    parent: int | None,
    state_dir: Path | None,
    change: str | None,
) -> None:
    """Run the router or one process of a train. Raises ConfigError."""
    if parent is not None:
        end_with_parent(parent)

    if role == "router":
        if config is not None and link:
            raise ConfigError("run", "--link", f"not with --config: {config} says itself, in `connect`, with whom it links")
        from milepost.security.router import run_named_router

        run_named_router(listen, config, parent, link)
        return
    from milepost.config.mistakes import one_of
    from milepost.config.roles import ROLES
    from milepost.config.train import load_train
    from milepost.runtime.process import ProcessOptions, run_process

    if role not in ROLES:
        raise ConfigError("run", "ROLE", one_of(["router", *ROLES], role))
    train = load_train(train_file, None if change is None else json.loads(change))
    units = ROLES[role].instances(train)
    if not ROLES[role].per_unit:
        unit = unit or role
    if unit not in units:
        raise ConfigError("run", "UNIT", one_of(units, unit) if units else f"{train_file} has none with a {role}")
    run_process(train, role, unit, ProcessOptions(connection, speed, duration, parent, state_dir, change))
