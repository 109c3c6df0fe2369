"""A shipped train with a third of its work, for tests that break it live: what they protect must hold on a slow machine too."""

from __future__ import annotations

from pathlib import Path

import yaml

TRAINS = Path(__file__).resolve().parent.parent / "deploy" / "trains"
PERIOD_MS = 60
RATE_HZ = 10.0


def lighter(name: str, folder: Path) -> Path:
    """The train file `name` with an epoch every 60 ms, at most 10 readings a second of each sensor, and no slip."""
    train = yaml.safe_load((TRAINS / f"{name}.yaml").read_text(encoding="utf-8"))
    train["line"] = str((TRAINS / train["line"]).resolve())
    train["fusion"]["period_ms"] = PERIOD_MS
    if "voting" in train["fusion"]:
        # fewer readings make wider intervals, of which two fusers that began at other times differ by more
        train["fusion"]["voting"]["interval_m"] = 3.0
    train["world"].pop("creep", None)
    for unit in train["units"].values():
        if "rate_hz" in unit:
            unit["rate_hz"] = min(unit["rate_hz"], RATE_HZ)
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump(train, sort_keys=False), encoding="utf-8")
    return file
