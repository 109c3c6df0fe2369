"""THE TABLE OF EVENTS: every code that a process can send, how bad it is, and what it means."""

from __future__ import annotations

from typing import Literal, NamedTuple

Severity = Literal["info", "warning", "error"]


class EventCode(NamedTuple):
    """One row: `code` as `event` carries it, with `REASON` for a word of its own."""

    code: str
    severity: Severity
    meaning: str


EVENT_CODES: tuple[EventCode, ...] = (
    EventCode("unit_absent", "warning", "a unit was never heard, or its process is gone"),
    EventCode("unit_silent", "warning", "a unit is heard no more"),
    EventCode("unit_late", "warning", "a unit's readings come too late for live states, and by how much"),
    EventCode("unit_heard", "info", "a unit is heard in time again"),
    EventCode("unit_excluded", "warning", "a unit no longer counts, with the evidence"),
    EventCode("unit_readmitted", "info", "a unit counts again"),
    EventCode("units_doubted", "warning", "units contradict each other, and nothing tells which is wrong"),
    EventCode("doubt_settled", "info", "units no longer contradict each other"),
    EventCode("motion_model_exceeded", "warning", "the train moves harder than its motion model says"),
    EventCode("motion_model_used_again", "info", "the train's own motion model is used again"),
    EventCode("fix_refused", "warning", "a balise was read where the train cannot be"),
    EventCode("state_reset", "warning", "the state stepped, and why"),
    EventCode("epochs_skipped", "warning", "the fuser was stopped for more than a second"),
    EventCode("snapshot_refused", "warning", "a restarted fuser does not use what another one knows, and why"),
    EventCode("fuser_outvoted", "error", "a fuser differed from two that agree in three epochs in a row: it has no vote"),
    EventCode("fuser_missing", "warning", "a fuser proposed nothing in three epochs in a row: it has no vote"),
    EventCode("fuser_readmitted", "info", "a fuser agreed with another one for the stated time: it has a vote again"),
    EventCode("fuser_began_again", "warning", "a fuser contradicted what was voted for a second, and continues from that"),
    EventCode("no_majority", "error", "no two fusers agree: nothing is published"),
    EventCode("majority_again", "info", "two fusers agree again, and how many epochs were not published"),
    EventCode("balise_missed", "warning", "a balise's window has been closed for a second without a telegram"),
    EventCode("balises_missed", "error", "two balises in a row were missed: the reader or the line's data are at fault"),
    EventCode("balises_read_again", "info", "balises are read again"),
    EventCode("balise_early", "warning", "a balise was read before its window"),
    EventCode("balise_late", "warning", "a balise was read behind its window"),
    EventCode("balise_out_of_order", "warning", "a balise was read while one before it may still come"),
    EventCode("balise_wrong_direction", "warning", "a balise was read after one that lies further in the direction of travel"),
    EventCode("balise_unexpected", "warning", "a balise was read outside its window, beyond another one"),
    EventCode("balise_repeated", "warning", "a balise was read again in the same window by a train that moves"),
    EventCode("unknown_balise", "warning", "a balise was read that the line does not have; it gives no fix"),
    EventCode("balise_misplaced", "error", "the line has a balise in the wrong place, and by how much"),
    EventCode("wheel_diameter", "info", "what an odometer's filter has learned of its wheel"),
    EventCode("wheel_spin", "warning", "a wheel's readings are left out: it turns faster than the train moves"),
    EventCode("wheel_slide", "warning", "a wheel's readings are left out: it turns slower than the train moves"),
    EventCode("wheel_off", "info", "a wheel's readings are left out: they contradict the belief"),
    EventCode("wheel_grips", "info", "a wheel's readings are taken again"),
    EventCode("wheel_doubtful", "error", "a wheel's readings are left out for long: its diameter may be wrong"),
    EventCode("gnss_not_trusted", "warning", "an RTK solution has to prove itself"),
    EventCode("gnss_trusted_again", "info", "an RTK solution has proved itself"),
    EventCode("gnss_frozen", "warning", "fixes stand still as no train can"),
    EventCode("gnss_ambiguous", "warning", "fixes are near two parts of the line, and nothing tells which"),
    EventCode("gnss_off_line", "warning", "fixes lie beyond the line's ends"),
    EventCode("error_learned", "warning", "an inertial unit's error is no longer learned: the fused state is not good enough"),
    EventCode("error_learning", "info", "an inertial unit's error is learned again"),
    EventCode("calibration_restored", "info", "what was kept of a wheel from an earlier run is used"),
    EventCode("calibration_unusable", "warning", "what was kept of a wheel from an earlier run is not used, and why"),
    EventCode("h_infinity_infeasible", "warning", "the filter's bound does not exist for its γ"),
    EventCode("h_infinity_feasible", "info", "the filter's bound exists again"),
    EventCode("second_instance", "error", "a process runs twice"),
    EventCode("one_instance", "info", "a process no longer runs twice"),
    EventCode("waiting_for", "info", "whom `world` waits for"),
    EventCode("began_without", "warning", "whom `world` began without"),
    EventCode("recording_stopped", "error", "nothing is recorded: the disk has too little room or cannot be written"),
    EventCode("recording_resumed", "info", "recording goes on, and how many messages are missing"),
    EventCode("messages_lost", "error", "messages came faster than the recorder's disk takes them, and how many are missing"),
    EventCode("fault_injected", "warning", "a fault was begun by `milepost inject`"),
    EventCode("fault_cleared", "info", "a unit's faults were ended by `milepost inject`"),
    EventCode("fault_refused", "warning", "a fault does not fit its unit"),
    EventCode("connection_refused", "warning", "whom a secure router did not let in, and why"),
    EventCode("access_refused", "warning", "what a secure router did not let a process or tool do"),
    EventCode("refused_REASON", "warning", "the first message that a process refuses for a reason; `health` counts all"),
)
