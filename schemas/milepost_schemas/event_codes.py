"""THE TABLE OF EVENTS: every code that a process can send, how bad it is, what it means and what to do about it."""

from __future__ import annotations

from typing import Literal, NamedTuple

Severity = Literal["info", "warning", "error"]


class EventCode(NamedTuple):
    """One row: `code` as `event` carries it, with `REASON` for a word of its own.

    `action`: what a person should do about it; nothing where it is empty.
    """

    code: str
    severity: Severity
    meaning: str
    action: str = ""


SILENT_DEVICE = "see whether its process runs and its device is connected; it counts again by itself"
LOAD = "see the load of the fuser's machine"
LINE_DATA = "compare the line file with the track there, and have the reader looked at"

EVENT_CODES: tuple[EventCode, ...] = (
    EventCode("unit_absent", "warning", "a unit was never heard, or its process is gone", SILENT_DEVICE),
    EventCode("unit_silent", "warning", "a unit is heard no more", SILENT_DEVICE),
    EventCode(
        "unit_late",
        "warning",
        "a unit's readings come too late for live states, and by how much",
        "see the load of its process and of the network",
    ),
    EventCode("unit_heard", "info", "a unit is heard in time again"),
    EventCode(
        "unit_excluded",
        "warning",
        "a unit no longer counts, with the evidence",
        "read the evidence; have the device looked at if it comes again",
    ),
    EventCode("unit_readmitted", "info", "a unit counts again"),
    EventCode(
        "units_doubted",
        "warning",
        "units contradict each other, and nothing tells which is wrong",
        "have both devices looked at if it lasts; until then the interval covers either",
    ),
    EventCode("doubt_settled", "info", "units no longer contradict each other"),
    EventCode(
        "motion_model_exceeded",
        "warning",
        "the train moves harder than its motion model says",
        "if it comes often, set `motion_model.jerk_psd_m2ps5` to what the train does",
    ),
    EventCode("motion_model_used_again", "info", "the train's own motion model is used again"),
    EventCode("fix_refused", "warning", "a balise was read where the train cannot be", LINE_DATA),
    EventCode(
        "state_reset", "warning", "the state stepped, and why", "see what was excluded before; consumers take the new position"
    ),
    EventCode("epochs_skipped", "warning", "the fuser was stopped for more than a second", LOAD),
    EventCode(
        "clock_wrong",
        "error",
        "the clock of a fuser, voter or filter differs from most others', or all that it hears comes late: it goes by theirs",
        "set the clock of its machine (PTP or NTP), or see what delays its connection",
    ),
    EventCode("clock_right", "info", "its clock is right again; a fuser may lead"),
    EventCode(
        "snapshot_refused",
        "warning",
        "a restarted fuser does not use what another one knows, and why",
        "give all fusers the same train and line files, if the text says that they differ",
    ),
    EventCode(
        "fuser_outvoted",
        "error",
        "a fuser differed from two that agree in three epochs in a row: it has no vote",
        "replace that fuser's machine, or restart it; its memory may be corrupted",
    ),
    EventCode("fuser_missing", "warning", "a fuser proposed nothing in three epochs in a row: it has no vote", LOAD),
    EventCode("fuser_readmitted", "info", "a fuser agreed with another one for the stated time: it has a vote again"),
    EventCode(
        "fuser_began_again",
        "warning",
        "a fuser contradicted what was voted for a second, and continues from that",
        "see whether it comes again: its machine may be at fault",
    ),
    EventCode(
        "no_majority",
        "error",
        "no two fusers agree: nothing is published",
        "do not use the position until `majority_again`; restart the fuser that differs",
    ),
    EventCode("majority_again", "info", "two fusers agree again, and how many epochs were not published"),
    EventCode(
        "balise_missed",
        "warning",
        "a balise's window has been closed for a second without a telegram",
        "if the same one is missed again, have it looked at; if others are, the reader",
    ),
    EventCode(
        "balises_missed",
        "error",
        "two balises in a row were missed: the reader or the line's data are at fault",
        "have the reader looked at, and compare the line file with the track",
    ),
    EventCode("balises_read_again", "info", "balises are read again"),
    EventCode("balise_early", "warning", "a balise was read before its window", LINE_DATA),
    EventCode("balise_late", "warning", "a balise was read behind its window", LINE_DATA),
    EventCode("balise_out_of_order", "warning", "a balise was read while one before it may still come", LINE_DATA),
    EventCode(
        "balise_wrong_direction",
        "warning",
        "a balise was read after one that lies further in the direction of travel",
        LINE_DATA,
    ),
    EventCode("balise_unexpected", "warning", "a balise was read outside its window, beyond another one", LINE_DATA),
    EventCode(
        "balise_repeated",
        "warning",
        "a balise was read again in the same window by a train that moves",
        "have the reader looked at",
    ),
    EventCode(
        "unknown_balise",
        "warning",
        "a balise was read that the line does not have; it gives no fix",
        "add it to the line file, or find out whose it is",
    ),
    EventCode(
        "balise_misplaced",
        "error",
        "the line has a balise in the wrong place, and by how much",
        "correct its `position_m` in the line file",
    ),
    EventCode("wheel_diameter", "info", "what an odometer's filter has learned of its wheel"),
    EventCode("wheel_spin", "warning", "a wheel's readings are left out: it turns faster than the train moves"),
    EventCode("wheel_slide", "warning", "a wheel's readings are left out: it turns slower than the train moves"),
    EventCode("wheel_off", "info", "a wheel's readings are left out: they contradict the belief"),
    EventCode("wheel_grips", "info", "a wheel's readings are taken again"),
    EventCode(
        "wheel_doubtful",
        "error",
        "a wheel's readings are left out for long: its diameter may be wrong",
        "measure the wheel and set the unit's `diameter_m`",
    ),
    EventCode("gnss_not_trusted", "warning", "an RTK solution has to prove itself"),
    EventCode("gnss_trusted_again", "info", "an RTK solution has proved itself"),
    EventCode("gnss_frozen", "warning", "fixes stand still as no train can", "restart the receiver"),
    EventCode("gnss_ambiguous", "warning", "fixes are near two parts of the line, and nothing tells which"),
    EventCode(
        "gnss_off_line", "warning", "fixes lie beyond the line's ends", "see whether the train is on the line of its train file"
    ),
    EventCode("error_learned", "warning", "an inertial unit's error is no longer learned: the fused state is not good enough"),
    EventCode("error_learning", "info", "an inertial unit's error is learned again"),
    EventCode("calibration_restored", "info", "what was kept of a wheel from an earlier run is used"),
    EventCode("calibration_unusable", "warning", "what was kept of a wheel from an earlier run is not used, and why"),
    EventCode(
        "h_infinity_infeasible",
        "warning",
        "the filter's bound does not exist for its γ",
        "give the unit's filter a larger `gamma`",
    ),
    EventCode("h_infinity_feasible", "info", "the filter's bound exists again"),
    EventCode(
        "process_failed",
        "error",
        "a process ends with an error, which the text names, and is started again",
        "report the error; where it comes again, leave out the unit that the text names",
    ),
    EventCode("second_instance", "error", "a process runs twice", "end all instances but one"),
    EventCode("one_instance", "info", "a process no longer runs twice"),
    EventCode("waiting_for", "info", "whom `world` waits for"),
    EventCode("began_without", "warning", "whom `world` began without", "start the process that is named"),
    EventCode(
        "recording_stopped",
        "error",
        "nothing is recorded: the disk has too little room or cannot be written",
        "make room on the recorder's disk, or give it another folder",
    ),
    EventCode("recording_resumed", "info", "recording goes on, and how many messages are missing"),
    EventCode(
        "messages_lost",
        "error",
        "messages came faster than the recorder's disk takes them, and how many are missing",
        "find out what is flooding the bus, or record to a faster disk",
    ),
    EventCode(
        "fault_injected",
        "warning",
        "a fault was begun by `milepost inject`",
        "if nobody meant it, find out who sends on `@chaos`, and run the train with `--secure`",
    ),
    EventCode("fault_cleared", "info", "a unit's faults were ended by `milepost inject`"),
    EventCode(
        "fault_refused", "warning", "a fault does not fit its unit", "choose one that the unit has: `milepost inject --list`"
    ),
    EventCode(
        "connection_refused",
        "warning",
        "whom a secure router did not let in, and why",
        "find out who it is; renew its certificate if it expired: `milepost pki issue`",
    ),
    EventCode(
        "access_refused",
        "warning",
        "what a secure router did not let a process or tool do",
        "find out who it is; `milepost acl` shows what it may do",
    ),
    EventCode(
        "refused_REASON",
        "warning",
        "the first message that a process refuses for a reason; `health` counts all",
        "read the text; `health` says how many, and of which process",
    ),
)
