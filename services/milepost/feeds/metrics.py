"""What is heard of the trains as Prometheus's metrics."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, get_args

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    StateSetMetricFamily,
)
from prometheus_client.metrics_core import Metric as Family

from milepost_schemas import BY_NAME as STREAMS
from milepost_schemas import EVENT_CODES, FusedState, Health, Spread
from milepost_schemas.state import Status

from .fleet import NS_PER_S, UNKNOWN, Fleet, ProcessView, TrainView
from .histogram import Histogram
from .metric_table import METRICS

FAMILIES: dict[str, type[Any]] = {
    "gauge": GaugeMetricFamily,
    "counter": CounterMetricFamily,
    "histogram": HistogramMetricFamily,
    "stateset": StateSetMetricFamily,
    "info": InfoMetricFamily,
}
SEVERITIES = {row.code: row.severity for row in EVENT_CODES}
# units of a state and reasons of a process, and letters of a reason; what a stranger sends beyond is left out
MOST_LABELS = 64


class Sample(NamedTuple):
    """A value of one series: the metric's name in the table, and its labels' values in the table's order."""

    name: str
    labels: tuple[str, ...]
    value: Any


def families(fleet: Fleet, now_ns: int) -> Iterator[Family]:
    """All metrics of the table, each with the series that there are now."""
    found: dict[str, list[Sample]] = defaultdict(list)
    for sample in _samples(fleet, now_ns):
        found[f"milepost_{sample.name}"].append(sample)
    for row in METRICS:
        family = FAMILIES[row.kind](row.name, row.help, labels=row.labels)
        for sample in found.pop(row.name, ()):
            if isinstance(sample.value, Histogram):
                family.add_metric(sample.labels, list(sample.value.buckets()), sample.value.sum)
            else:
                family.add_metric(sample.labels, sample.value)
        yield family
    assert not found, f"not in the metrics table: {', '.join(found)}"


def _samples(fleet: Fleet, now_ns: int) -> Iterator[Sample]:
    yield Sample("feed_left_out", (), fleet.left_out)
    for name, train in fleet.trains.items():
        yield from _counted(name, train)
        state = train.current(now_ns)
        if state is not None:
            yield from _motion(name, state)
            yield from _units(name, state, train.exclusions)
        for unit, process in train.processes.items():
            # what has ended is no series any more
            if process.instances:
                yield from _process((name, unit), process)


def _counted(name: str, train: TrainView) -> Iterator[Sample]:
    for code, count in train.events.items():
        yield Sample("events", (name, code, SEVERITIES.get(code, UNKNOWN)), count)
    if train.state is None:
        return
    yield Sample("state_received_timestamp_seconds", (name,), train.state_ns / NS_PER_S)
    yield Sample("states", (name,), train.states)
    yield Sample("states_missing", (name,), train.missing)
    yield Sample("states_incomplete", (name,), train.incomplete)
    yield Sample("state_resets", (name,), train.resets)
    yield Sample("state_latency_seconds", (name,), train.latency)
    yield Sample("state_delivery_seconds", (name,), train.delivery)


def _motion(name: str, state: FusedState) -> Iterator[Sample]:
    yield Sample("status", (name,), {status: status == state.status for status in get_args(Status)})
    yield Sample("line", (name,), {"line": state.line, "line_hash": state.line_hash[:32]})
    for metric, value in (
        ("position_meters", state.position_m),
        ("position_interval_width_meters", state.position_max_m - state.position_min_m),
        ("position_accuracy_meters", state.position_accuracy_m),
        ("speed_meters_per_second", state.speed_mps),
        ("speed_interval_width_meters_per_second", state.speed_max_mps - state.speed_min_mps),
        ("speed_accuracy_meters_per_second", state.speed_accuracy_mps),
        ("acceleration_meters_per_second_squared", state.acceleration_mps2),
    ):
        yield Sample(metric, (name,), value)
    if state.last_balise is not None:
        yield Sample("balise_distance_meters", (name,), state.last_balise.distance_since_m)


def _units(name: str, state: FusedState, exclusions: dict[str, int]) -> Iterator[Sample]:
    in_use = {each.unit: each for each in state.sensors[:MOST_LABELS]}
    excluded = {each.unit: each for each in state.excluded[:MOST_LABELS]}
    for unit, sensor in in_use.items():
        yield Sample("unit_share_ratio", (name, unit), sensor.share)
        yield Sample("unit_age_seconds", (name, unit), sensor.age_s)
    for unit, left_out in excluded.items():
        yield Sample("unit_excluded", (name, unit, left_out.kind or UNKNOWN), 1)
    for unit in in_use | excluded:
        yield Sample("unit_doubted", (name, unit), unit in state.doubted)
        yield Sample("unit_awaited", (name, unit), unit in state.awaiting)
        yield Sample("unit_exclusions", (name, unit), exclusions.get(unit, 0))


def _process(labels: tuple[str, str], process: ProcessView) -> Iterator[Sample]:
    yield Sample("process_instances", labels, len(process.instances))
    yield Sample("process_restarts", labels, process.restarts)
    health = process.health
    if health is None:
        return
    yield Sample("process_uptime_seconds", labels, health.uptime_s)
    yield Sample("process_health_timestamp_seconds", labels, process.health_ns / NS_PER_S)
    yield Sample("process_rewinds", labels, health.rewinds)
    yield Sample("process_gaps", labels, health.gaps)
    yield from _rates(labels, health)
    reasons = [reason for reason in health.refused if len(reason) <= MOST_LABELS]
    for reason in reasons[:MOST_LABELS]:
        yield Sample("process_refused", (*labels, reason), health.refused[reason])
    yield from _spread("process_step_seconds", labels, health.step_us, 1e-6)
    yield from _spread("process_delivery_seconds", labels, health.latency_ms, 1e-3)


def _rates(labels: tuple[str, str], health: Health) -> Iterator[Sample]:
    for metric, rates in (
        ("process_received_hertz", health.received_hz),
        ("process_sent_hertz", health.sent_hz),
        ("process_expected_hertz", health.expected_hz),
    ):
        for stream in rates.keys() & STREAMS.keys():
            yield Sample(metric, (*labels, stream), rates[stream])


def _spread(metric: str, labels: tuple[str, str], spread: Spread | None, unit: float) -> Iterator[Sample]:
    pairs: Iterable[tuple[str, float]] = (
        () if spread is None else (("0.5", spread.p50), ("0.99", spread.p99), ("1", spread.max))
    )
    for quantile, value in pairs:
        yield Sample(metric, (*labels, quantile), value * unit)
