"""One train in rows of fields: what it says of itself, its sensors, its events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from milepost.feeds.fleet import NS_PER_S
from milepost_schemas import FusedState, Health, Truth

from .heard import Told, TrainHeard
from .possible import possible
from .rows import Fields, Rows
from .words import DIRECTIONS, NBSP, SEVERITIES, STATUSES, UNKNOWN, Level, age, figure, kind_word, kmh, meaning_of

# rows of the train, of a sensor, of a hypothesis and of an event
HEAD, UNIT, HYPOTHESIS, EVENT = "head", "unit/", "hypothesis/", "event/"
# a stream with less than this share of its expected rate is slow
SLOW = 0.8
# truth is carried over to a state that is at most so far from it
NEAR_NS = NS_PER_S // 5
FIGURES = (
    *("position", "position_bounds", "width", "accuracy", "speed", "speed_bounds"),
    *("acceleration", "direction", "balise", "place"),
)


def one_train(train: TrainHeard, now_ns: int) -> Rows:
    """All rows of a train."""
    rows: Rows = {HEAD: _head(train, now_ns)}
    state = train.current(now_ns)
    rows |= {f"{UNIT}{fields['unit']}": fields for fields in _units(train.state, state is not None, train.healths)}
    rows |= {f"{HYPOTHESIS}{place:03}": fields for place, fields in enumerate(possible(train.hypotheses, state))}
    return rows | {f"{EVENT}{told.number}": _event(told) for told in train.all_events()}


def nobody(name: str) -> Rows:
    """What is shown of a train that is not heard."""
    words = STATUSES[UNKNOWN]
    return {HEAD: {"name": name, "status": UNKNOWN, "level": words.level, "word": words.word, "meaning": words.meaning}}


def _head(train: TrainHeard, now_ns: int) -> Fields:
    status = train.status(now_ns)
    words, state = STATUSES[status], train.current(now_ns)
    last = train.state
    fields: Fields = {
        "name": train.name,
        "status": status,
        "level": words.level,
        "word": words.word,
        "meaning": words.meaning,
        "age": "none yet" if train.age_s(now_ns) is None else f"{age(train.age_s(now_ns))} ago",
        "line": last.line if last else UNKNOWN,
        "last_known": "",
        # where to draw it, also when it is silent: then it is drawn as the last place that was known
        "at_m": _rounded(last.position_m if last else None),
        "from_m": _rounded(last.position_min_m if last else None),
        "to_m": _rounded(last.position_max_m if last else None),
        "fresh": 1.0 if state is not None else 0.0,
        "now_s": _rounded(train.now_s(now_ns), 0),
        "published_ms": last.published_at_ns // 1_000_000 if last else None,
    }
    if state is None and last is not None:
        fields["last_known"] = f"last known {figure(last.position_m, 1)} m, {age(train.age_s(now_ns))} ago"
    return fields | _figures(state) | _truth(state, train.truth) | _out_of_use(state)


def _figures(state: FusedState | None) -> Fields:
    if state is None:
        return dict.fromkeys(FIGURES, UNKNOWN)
    balise = state.last_balise
    return {
        "position": figure(state.position_m, 2),
        "position_bounds": f"{figure(state.position_min_m, 2)} to {figure(state.position_max_m, 2)}{NBSP}m",
        "width": figure(state.position_max_m - state.position_min_m, 2),
        "accuracy": f"±{NBSP}{figure(state.position_accuracy_m, 2)}{NBSP}m, 95{NBSP}%",
        "speed": kmh(state.speed_mps),
        "speed_bounds": f"{kmh(state.speed_min_mps)} to {kmh(state.speed_max_mps)}{NBSP}km/h",
        "acceleration": f"{figure(state.acceleration_mps2, 2)}{NBSP}m/s²",
        "direction": DIRECTIONS[state.direction],
        "balise": f"{balise.balise_id}, {figure(balise.distance_since_m, 0)} m ago" if balise else "none yet",
        "place": _place(state),
    }


def _place(state: FusedState) -> str:
    if state.latitude_deg is None or state.longitude_deg is None:
        return "the line has no geometry"
    return f"{state.latitude_deg:.6f}°, {state.longitude_deg:.6f}°"


def _truth(state: FusedState | None, truth: Truth | None) -> Fields:
    """The true error, where a simulated train tells it: the nearest truth, carried over to the state's time."""
    nothing: Fields = {"error": "", "error_level": "idle", "true_m": None}
    if state is None or truth is None:
        return nothing
    apart_ns = state.measured_at_ns - truth.measured_at_ns
    if abs(apart_ns) > NEAR_NS:
        return nothing
    T = apart_ns / NS_PER_S
    true_m = truth.position_m + truth.speed_mps * T + 0.5 * truth.acceleration_mps2 * T * T
    inside = state.position_min_m <= true_m <= state.position_max_m
    where = "inside the protected interval" if inside else "OUTSIDE the protected interval"
    level: Level = "ok" if inside else "bad"
    return {
        "error": f"{_signed(state.position_m - true_m)} m, {where}",
        "error_level": level,
        "true_m": _rounded(true_m),
    }


def _signed(metres: float) -> str:
    text = figure(metres, 2)
    return text if text.startswith("-") or float(text) == 0.0 else f"+{text}"


def _out_of_use(state: FusedState | None) -> Fields:
    """What does not count, and what is contradicted, in words."""
    if state is None:
        return {"excluded": UNKNOWN, "doubted": UNKNOWN}
    return {
        "excluded": "; ".join(f"{each.unit}: {kind_word(each.kind)}" for each in state.excluded) or "none",
        "doubted": f"{' and '.join(state.doubted)} contradict each other" if state.doubted else "none",
    }


def _units(state: FusedState | None, fresh: bool, healths: Mapping[str, Health]) -> Iterator[Fields]:
    if state is None:
        return
    found: dict[str, Fields] = {}
    for used in state.sensors:
        found[used.unit] = _in_use(state, used.unit, used.share, used.age_s)
    for out in state.excluded:
        level: Level = "warn" if out.says_nothing else "bad"
        found[out.unit] = _unit(out.unit, level, f"excluded: {kind_word(out.kind)}", out.reason)
    for name in sorted(found):
        fields = found[name]
        fields["rate"] = _rate(healths.get(f"filter-{name}") or healths.get(f"sensor-{name}"))
        if not fresh:
            fields |= _unit(name, "idle", UNKNOWN, "") | {"rate": UNKNOWN, "age": UNKNOWN}
        yield fields


def _in_use(state: FusedState, unit: str, share: float, age_s: float) -> Fields:
    if unit in state.doubted:
        others = " or ".join(each for each in state.doubted if each != unit)
        fields = _unit(unit, "warn", "doubted", f"contradicts {others}" if others else "")
    elif unit in state.awaiting:
        fields = _unit(unit, "ok", "in use, late", "")
    else:
        fields = _unit(unit, "ok", "in use", "")
    return fields | {"share": round(share, 2), "age": f"{age_s * 1e3:.0f} ms" if age_s < 1.0 else age(age_s)}


def _unit(unit: str, level: Level, judgement: str, detail: str) -> Fields:
    return {"unit": unit, "level": level, "judgement": judgement, "detail": detail, "share": None, "age": "–", "rate": "–"}


def _rate(health: Health | None) -> str:
    if health is None:
        return UNKNOWN
    rate, expected = (
        sum(rate for name, rate in rates.items() if name.endswith("_reading"))
        for rates in (health.received_hz or health.sent_hz, health.expected_hz)
    )
    if rate == expected == 0.0:
        return "when it passes one" if "balise_telegram" in {**health.sent_hz, **health.expected_hz} else "0 Hz"
    return f"{rate:.0f} of {expected:.0f} Hz" if rate < SLOW * expected else f"{rate:.0f} Hz"


def _event(told: Told) -> Fields:
    event, row = told.event, meaning_of(told.event.code)
    return {
        "at_ms": event.measured_at_ns // 1_000_000,
        "severity": event.severity,
        "level": SEVERITIES[event.severity],
        "unit": event.unit,
        "what": event.code.replace("_", " "),
        "text": event.text,
        "action": row.action if row is not None else "",
    }


def _rounded(value: float | None, decimals: int = 2) -> float | None:
    return None if value is None else round(value, decimals)
