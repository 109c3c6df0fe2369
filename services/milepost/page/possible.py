"""The hypotheses of a train in rows of fields: what if this unit lies?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from milepost.feeds.fleet import NS_PER_S
from milepost.fusion.hypotheses import MOTION_MODEL
from milepost_schemas import FusedState, Hypotheses
from milepost_schemas.hypotheses import Judgement

from .rows import Fields
from .words import KMH_PER_MPS, NBSP, Level, figure

# they come once a second
FRESH_NS = 3 * NS_PER_S


class JudgementWords(NamedTuple):
    """A judgement as it is shown."""

    word: str
    level: Level


JUDGEMENTS: dict[Judgement, JudgementWords] = {
    "leads": JudgementWords("published", "ok"),
    "held": JudgementWords("possible", "info"),
    "unlikely": JudgementWords("unlikely", "idle"),
    "refuted": JudgementWords("refuted", "bad"),
}


def possible(told: Hypotheses | None, state: FusedState | None) -> Iterator[Fields]:
    """A row for each hypothesis, while the newest are of about the state's time: how far it is from the one that leads."""
    if told is None or state is None or abs(state.measured_at_ns - told.measured_at_ns) > FRESH_NS:
        return
    leading = next((each for each in told.hypotheses if each.judgement == "leads"), None)
    lead_m, lead_kmh = (None, None) if leading is None else (leading.position_m, leading.speed_mps * KMH_PER_MPS)
    for each in told.hypotheses:
        words = JUDGEMENTS[each.judgement]
        yield {
            "if": condition(each.without),
            "word": words.word,
            "level": words.level,
            "apart_m": _apart(each.position_m, each.position_std_m, lead_m, "m", 2),
            "apart_kmh": _apart(each.speed_mps * KMH_PER_MPS, each.speed_std_mps * KMH_PER_MPS, lead_kmh, "km/h", 2),
        }


def condition(without: list[str]) -> str:
    """`radar and loop lie`."""
    units = [unit for unit in without if unit != MOTION_MODEL]
    hard = "the train moves harder than its file says" if MOTION_MODEL in without else ""
    if not units:
        return hard or "nobody lies"
    last = " and ".join(units[-2:])
    lie = f"{', '.join([*units[:-2], last])} {'lies' if len(units) == 1 else 'lie'}"
    return f"{lie}, and {hard}" if hard else lie


def _apart(value: float, std: float, leading: float | None, unit: str, decimals: int) -> str:
    """The difference from what leads, with its sign, and the standard deviation."""
    if leading is None:
        return figure(value, decimals)
    text = figure(value - leading, decimals)
    sign = "" if text.startswith("-") or float(text) == 0.0 else "+"
    return f"{sign}{text} ± {figure(std, decimals)}{NBSP}{unit}"
