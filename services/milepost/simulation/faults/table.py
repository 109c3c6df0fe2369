"""THE TABLE OF FAULTS: what can go wrong with a unit's readings."""

from __future__ import annotations

from . import content, sending
from .effect import FaultKind

SPEED, POSITION, INERTIAL, BALISE = "speed_reading", "position_reading", "inertial_reading", "balise_telegram"
VALUES = (SPEED, INERTIAL)
MEASURED = (SPEED, POSITION, INERTIAL)
ALL = (*MEASURED, BALISE)

FAULTS: dict[str, FaultKind] = {
    row.name: row
    for row in (
        FaultKind("bias", "reads so much more", content.Size, content.bias, MEASURED),
        FaultKind("ramp", "reads more by so much per second", content.Rate, content.ramp, MEASURED),
        FaultKind("scale", "reads so many times as much", content.Factor, content.scale, VALUES),
        FaultKind("stuck", "repeats its last content under new stamps", content.NoOptions, content.stuck, MEASURED),
        FaultKind("noise", "is noisier than it states", content.Noise, content.noise, MEASURED),
        FaultKind("drop_out", "sends nothing", content.NoOptions, sending.drop_out, ALL),
        FaultKind("intermittent", "has a bias on and off", content.Intermittent, content.intermittent, MEASURED),
        FaultKind("jump", "steps along the track", content.Size, content.bias, (POSITION,)),
        FaultKind("delay", "sends late, with honest stamps", sending.Seconds, sending.delay, ALL),
        FaultKind("restamp", "sends old content as new, under another instance", content.Restamp, content.restamp, ALL),
        FaultKind("duplicate", "sends every reading again under other instances", sending.Duplicate, sending.duplicate, ALL),
        FaultKind("clock_step", "has a clock that is off", sending.Step, sending.clock_step, ALL),
        FaultKind("clock_drift", "has a clock that is fast or slow", sending.Drift, sending.clock_drift, ALL),
        FaultKind("late_stamp", "sends and stamps later than it measures", sending.Seconds, sending.late_stamp, ALL),
        FaultKind("spin", "turns faster than the train moves", content.Spin, content.creep, (SPEED,), ("odometer",)),
        FaultKind("slide", "turns slower than the train moves", content.Slide, content.creep, (SPEED,), ("odometer",)),
        FaultKind("false_rtk", "is off, and calls itself RTK-fixed", content.FalseRtk, content.false_rtk, (POSITION,)),
        FaultKind("drag", "is pulled away along the track", content.Drag, content.drag, (POSITION,)),
        FaultKind(
            "wrong_balise",
            "says another balise's id",
            sending.WrongBalise,
            sending.wrong_balise,
            (BALISE,),
            passes_over=sending.other_telegram,
        ),
        FaultKind(
            "moved_balise",
            "reads a balise that lies elsewhere than on the map",
            sending.MovedBalise,
            sending.moved_balise,
            (BALISE,),
            needs_motion=True,
            passes_over=sending.other_telegram,
        ),
        FaultKind(
            "missed_balise",
            "reads no balise",
            sending.OfBalise,
            sending.drop_out,
            (BALISE,),
            passes_over=sending.other_telegram,
        ),
    )
}
