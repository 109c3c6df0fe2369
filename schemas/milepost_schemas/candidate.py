"""What one of three fusers would publish of an epoch."""

from __future__ import annotations

from typing import ClassVar

from pydantic import model_validator

from .estimate import Feedback
from .message import Message
from .state import FusedState


class Candidate(Message):
    """What the fuser `unit` would publish of the epoch `measured_at_ns`, for the voter alone; no dispatch tool uses it.

    `feedback`: where the train file asks for feedback in this epoch.
    """

    SCHEMA: ClassVar[str] = "candidate"

    state: FusedState
    feedback: Feedback | None = None

    @model_validator(mode="after")
    def _of_one_epoch(self) -> Candidate:
        parts = (self.state,) if self.feedback is None else (self.state, self.feedback)
        if any(part.measured_at_ns != self.measured_at_ns for part in parts):
            raise ValueError("state and feedback must be of the candidate's epoch")
        return self
