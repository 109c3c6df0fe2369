"""The table of working states knows every word for a unit that is not in use, and every kind that messages may have."""

from __future__ import annotations

from typing import get_args

import pytest

from milepost.fusion import evidence
from milepost.fusion.verdicts import SHOWN
from milepost.nodes.working_states import KINDS, kind_of
from milepost_schemas.state import SAYS_NOTHING, SensorExcluded, WorkingState


def test_every_kind_of_a_message_has_a_word() -> None:
    assert {*KINDS.values(), kind_of("off_track")} == set(get_args(WorkingState))


def test_every_word_of_the_bank_has_a_kind_of_its_own() -> None:
    said = {*evidence.KINDS, "spinning", "sliding", *SHOWN, *(kind for kinds in SHOWN.values() for kind in kinds)}
    assert said <= KINDS.keys()
    assert not {KINDS[word] for word in said} & {*SAYS_NOTHING, "refused"}


@pytest.mark.parametrize("kind", get_args(WorkingState))
def test_a_consumer_tells_silence_from_lies_without_the_words(kind: WorkingState) -> None:
    entry = SensorExcluded(unit="radar", reason="whatever the words are", kind=kind)
    assert entry.says_nothing == (kind in ("absent", "silent", "late"))


def test_a_state_of_an_older_fuser_is_still_read() -> None:
    assert SensorExcluded.model_validate({"unit": "radar", "reason": "silent"}).kind is None
