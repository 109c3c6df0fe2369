"""THE METRICS TABLE: every metric that is exported. Dashboard, alerts and documentation are checked against it."""

from __future__ import annotations

from typing import Literal, NamedTuple

Kind = Literal["gauge", "counter", "histogram", "stateset", "info"]
TRAIN = ("train",)
UNIT = ("train", "unit")
PROCESS = ("train", "process")
STREAM = ("train", "process", "stream")
QUANTILE = ("train", "process", "quantile")


class Metric(NamedTuple):
    """One row; `name` is without the suffix that Prometheus adds to counters (`_total`) and infos (`_info`)."""

    name: str
    kind: Kind
    labels: tuple[str, ...]
    help: str


METRICS: tuple[Metric, ...] = (
    Metric("milepost_status", "stateset", TRAIN, "The train's status: 1 for the one that it has."),
    Metric("milepost_line", "info", TRAIN, "The line that the train is on."),
    Metric("milepost_position_meters", "gauge", TRAIN, "Position along the line."),
    Metric("milepost_position_interval_width_meters", "gauge", TRAIN, "Width of the interval that holds the true position."),
    Metric("milepost_position_accuracy_meters", "gauge", TRAIN, "Accuracy of the position without faults, 95 %."),
    Metric("milepost_speed_meters_per_second", "gauge", TRAIN, "Speed, positive towards higher chainage."),
    Metric(
        "milepost_speed_interval_width_meters_per_second", "gauge", TRAIN, "Width of the interval that holds the true speed."
    ),
    Metric("milepost_speed_accuracy_meters_per_second", "gauge", TRAIN, "Accuracy of the speed without faults, 95 %."),
    Metric("milepost_acceleration_meters_per_second_squared", "gauge", TRAIN, "Acceleration."),
    Metric("milepost_balise_distance_meters", "gauge", TRAIN, "Distance travelled since the last balise."),
    Metric("milepost_state_received_timestamp_seconds", "gauge", TRAIN, "When the newest state was received, Unix time."),
    Metric("milepost_states", "counter", TRAIN, "States received."),
    Metric("milepost_states_missing", "counter", TRAIN, "Epochs of which no state was received."),
    Metric("milepost_states_incomplete", "counter", TRAIN, "States that were sent before a due reading had arrived."),
    Metric("milepost_state_resets", "counter", TRAIN, "Steps of the state by more than its own uncertainty."),
    Metric("milepost_state_latency_seconds", "histogram", TRAIN, "From the epoch of a state to its publication."),
    Metric("milepost_state_delivery_seconds", "histogram", TRAIN, "From the publication of a state to its receipt here."),
    Metric(
        "milepost_events", "counter", ("train", "code", "severity"), "Events received, by their row in the table of events."
    ),
    Metric("milepost_unit_share_ratio", "gauge", UNIT, "The unit's share of information."),
    Metric("milepost_unit_age_seconds", "gauge", UNIT, "Age of the unit's last observation in the newest state."),
    Metric(
        "milepost_unit_excluded", "gauge", ("train", "unit", "kind"), "1 while the unit is not in use, by the kind of reason."
    ),
    Metric("milepost_unit_doubted", "gauge", UNIT, "1 while the unit contradicts others and nothing tells which is wrong."),
    Metric("milepost_unit_awaited", "gauge", UNIT, "1 if the newest state was sent before this unit's due reading."),
    Metric("milepost_unit_exclusions", "counter", UNIT, "How often the unit went out of use."),
    Metric("milepost_process_instances", "gauge", PROCESS, "Instances of the process; more than one is an error."),
    Metric("milepost_process_restarts", "counter", PROCESS, "Instances that appeared after the first one."),
    Metric("milepost_process_uptime_seconds", "gauge", PROCESS, "How long the process has been running."),
    Metric("milepost_process_health_timestamp_seconds", "gauge", PROCESS, "When the last health was received, Unix time."),
    Metric("milepost_process_received_hertz", "gauge", STREAM, "Messages a second received, over all units of the stream."),
    Metric("milepost_process_sent_hertz", "gauge", STREAM, "Messages a second sent."),
    Metric("milepost_process_expected_hertz", "gauge", STREAM, "The least rate that the train file sets for the stream."),
    Metric("milepost_process_refused", "counter", ("train", "process", "reason"), "Messages refused, by reason."),
    Metric("milepost_process_rewinds", "counter", PROCESS, "Rewinds, because a message came late."),
    Metric(
        "milepost_process_gaps",
        "counter",
        PROCESS,
        "Messages not taken, by their sequence numbers: lost, or skipped where only the newest matters.",
    ),
    Metric("milepost_process_step_seconds", "gauge", QUANTILE, "Duration of a step over the last second."),
    Metric("milepost_process_delivery_seconds", "gauge", QUANTILE, "From publication to receipt of messages, last second."),
    Metric("milepost_feed_left_out", "counter", (), "Messages of trains and processes beyond what is followed."),
)
BY_NAME = {row.name: row for row in METRICS}
