"""Detection of wheel spin and slide against the fused speed, and reports of the wheel's diameter."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, Field

from milepost.estimation.notice import Notice
from milepost.recordings.options import STRICT

from ..observed import Belief, Observed
from ..scale import SCALE

Observe = Callable[[Any, Belief | None], Sequence[Observed]]
Positive = Annotated[float, Field(gt=0.0)]
REASONS = {"wheel_spin": "spinning", "wheel_slide": "sliding"}


class SlipOptions(BaseModel):
    """The thresholds of slip.

    `spin_ratio`, `slide_ratio`: source D's λ_slip and λ_slide. `sigmas`: a reading this many standard deviations from its
    prediction does not count; from `doubt_sigmas` on its variance is raised. `hold_s`: how long the readings must agree with
    their predictions before they count again. `longest_s`: a longer slip means a wrong diameter. Below `least_speed_mps` the
    slip ratio is not used. `report_every_m`: the distance between reports of the diameter.
    """

    model_config = STRICT

    spin_ratio: Annotated[float, Field(lt=0.0)] = -0.02
    slide_ratio: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.02
    sigmas: Positive = 4.0
    doubt_sigmas: Positive = 2.5
    hold_s: Positive = 0.5
    longest_s: Positive = 30.0
    least_speed_mps: Positive = 0.5
    report_every_m: Positive = 100.0


class SlipMemory(NamedTuple):
    """The memory of a wheel's slip detector.

    `off_since_s`: since when its readings do not count; `agrees_since_s`: since when they agree with the fused speed again.
    `slip`: the event that was reported; `too_long`: whether it lasted longer than `longest_s`. `too_far_m`: the distance that
    the wheel ran further than the train. `mark`, `reported`: the last mark passed, and the last one with a report of the
    diameter. `refused`: the reason for which the last reading did not count.
    """

    off_since_s: float | None = None
    agrees_since_s: float | None = None
    slip: str | None = None
    too_long: bool = False
    too_far_m: float = 0.0
    mark: int | None = None
    reported: int | None = None
    refused: str | None = None

    def gripping(self) -> SlipMemory:
        """The memory of a wheel that grips again."""
        return SlipMemory(mark=self.mark, reported=self.reported)


class WheelWatch:
    """Detects slip and refuses a slipping wheel's readings; its only time is that of the readings.

    With the observation z = h x + e and ν = z - h x̂, S = h P hᵀ + R against the fused belief: h has 1 for the speed, so
    ν = v_w - v̂, v_w the wheel's speed at its true diameter, and the slip ratio is λ = (v̂ - v_w)/v̂ = -ν/v̂. λ ≤ λ_slip is
    spin, λ ≥ λ_slide slide. |ν| > k √S: the reading does not count, whatever λ is, nor any after it until the wheel has run
    as expected for a while; so a threshold that the fused speed is too uncertain to decide is not decided. Short of that R
    grows to (ν/k_d)² - h P hᵀ: the ramp of a slip is in doubt before it is sure. Source: D (18), lost in the text: λ is a
    reconstruction from its thresholds; the rest is ours.
    """

    def __init__(self, observe: Observe, options: SlipOptions, nominal_diameter_m: float) -> None:
        self._observe = observe
        self._options = options
        self._nominal_diameter_m = nominal_diameter_m
        self._notices: list[Notice] = []
        self.memory = SlipMemory()

    def restarted(self) -> None:
        """Do nothing: slip shows in the first reading against the fused state."""

    @property
    def gating(self) -> str | None:
        """The kind of slip, or that the wheel contradicts the fused speed, while its readings do not count."""
        return None if self.memory.off_since_s is None else REASONS.get(self.memory.slip or "", "contradicts the fused speed")

    @property
    def refused(self) -> str | None:
        """The reason for which the last reading did not count."""
        return self.memory.refused

    def notices(self) -> list[Notice]:
        """The notices since the last call."""
        out, self._notices = self._notices, []
        return out

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """The reading's observation, with a raised variance where it is in doubt; nothing while the wheel slips."""
        observed = self._observe(reading, belief)
        if belief is None or not observed:
            return observed
        self._report_diameter(belief)
        row, value, R = observed[0]
        nu = value - float(belief.mean @ row)
        hPh = float(belief.covariance @ row @ row)
        expected = abs(nu) <= self._options.sigmas * math.sqrt(hPh + R)
        if not expected:
            self._off(reading, belief, nu)
        memory = self.memory
        if memory.off_since_s is not None:
            self.memory = memory._replace(too_far_m=memory.too_far_m + nu * reading.interval_s)
            if not (expected and self._agrees_again(reading.measured_at_ns * 1e-9)):
                self.memory = self.memory._replace(refused=self.gating)
                return ()
        return (Observed(row, value, max(R, (nu / self._options.doubt_sigmas) ** 2 - hPh)),)

    def _off(self, reading: Any, belief: Belief, nu: float) -> None:
        t_s, options = reading.measured_at_ns * 1e-9, self._options
        first = self.memory.off_since_s is None
        since_s = t_s if self.memory.off_since_s is None else self.memory.off_since_s
        v = float(belief.mean[1])
        ratio = -nu / v if abs(v) >= options.least_speed_mps else 0.0
        slip = "wheel_spin" if ratio <= options.spin_ratio else "wheel_slide" if ratio >= options.slide_ratio else None
        reported, too_long = self.memory.slip, self.memory.too_long
        if slip is not None and slip != reported:
            reported = slip
            text = f"slip ratio {ratio:+.3f} at {abs(v) * 3.6:.1f} km/h: its filter leaves its readings out"
            self._notices.append(Notice("warning", slip, text))
        elif first:
            text = f"{nu:+.3f} m/s off the fused speed of {abs(v) * 3.6:.1f} km/h: its filter leaves its readings out"
            self._notices.append(Notice("info", "wheel_off", text))
        if t_s - since_s > options.longest_s and not too_long:
            too_long = True
            text = f"{100.0 * abs(ratio):.2f} % off the fused speed for over {options.longest_s:g} s: is the diameter right?"
            self._notices.append(Notice("error", "wheel_doubtful", text))
        self.memory = self.memory._replace(off_since_s=since_s, agrees_since_s=None, slip=reported, too_long=too_long)

    def _agrees_again(self, t_s: float) -> bool:
        """Whether the readings have agreed with the fused speed for `hold_s`; the wheel then grips."""
        memory = self.memory
        agrees_since_s = t_s if memory.agrees_since_s is None else memory.agrees_since_s
        if t_s - agrees_since_s < self._options.hold_s:
            self.memory = memory._replace(agrees_since_s=agrees_since_s)
            return False
        if memory.off_since_s is not None:
            text = f"after {t_s - memory.off_since_s:.1f} s; the wheel had run {memory.too_far_m:+.2f} m further than the train"
            self._notices.append(Notice("info", "wheel_grips", text))
        self.memory = memory.gripping()
        return True

    def _report_diameter(self, belief: Belief) -> None:
        position, k = float(belief.mean[0]), float(belief.mean[SCALE])
        mark = math.floor(position / self._options.report_every_m)
        before = self.memory.mark
        if before == mark:
            return
        self.memory = self.memory._replace(mark=mark)
        passed = mark if before is None else max(before, mark)
        # while a train stands on a mark, its estimated position passes the mark again and again
        if before is None or passed == self.memory.reported:
            return
        self.memory = self.memory._replace(reported=passed)
        diameter_mm = 1e3 * self._nominal_diameter_m * (1.0 + k)
        std_mm = 1e3 * self._nominal_diameter_m * math.sqrt(float(belief.covariance[SCALE, SCALE]))
        text = f"{diameter_mm:.2f} mm ± {std_mm:.2f} at {position:.1f} m (nominal {1e3 * self._nominal_diameter_m:.1f} mm)"
        self._notices.append(Notice("info", "wheel_diameter", text))
