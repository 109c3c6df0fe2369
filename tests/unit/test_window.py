"""A part of a recording: the messages of a window and no others, whether the file was finished or not."""

from __future__ import annotations

from pathlib import Path

import pytest

from examples import T0, head
from milepost.cli.recording.describe import run_export
from milepost.config.errors import ConfigError
from milepost.recorder.file import RecordingFile
from milepost.recorder.incoming import Incoming, head_of
from milepost.recorder.reading import McapReader
from milepost.recorder.window import ALL, NS_PER_S, Window, window_of
from milepost_schemas import SpeedReading, encode

RADAR, LATE = "milepost/v1/maglev-1/reading/radar", "milepost/v1/maglev-1/reading/late"
# enough for several chunks
SECONDS = 40


def sent() -> list[Incoming]:
    """A message a second, with a payload that no compression makes small; the second unit begins in the middle."""
    out = []
    for n in range(SECONDS):
        reading = SpeedReading(**head(sequence=n), speed_mps=20.0, speed_variance_m2ps2=0.04)
        out.append(Incoming(RADAR if n < SECONDS // 2 else LATE, SpeedReading.encoding(), T0 + n * NS_PER_S, encode(reading)))
    return out


def recording(folder: Path, finished: bool = True) -> Path:
    path = folder / "a.mcap"
    file = RecordingFile(path)
    for each in sent():
        file.add(each, head_of(each.payload))
        # each in a chunk of its own
        file.flush()
    if finished:
        file.close()
    return path


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize(("since", "until"), [(0, SECONDS), (5, 9), (19, 21), (30, 99), (39, 40), (50, 60)])
def test_the_messages_of_the_window_come_and_no_others(tmp_path: Path, finished: bool, since: int, until: int) -> None:
    """The end is not in it, so that two windows that meet share nothing. A file that was not finished has no index."""
    window = Window(T0 + since * NS_PER_S, T0 + until * NS_PER_S)
    assert list(McapReader(recording(tmp_path, finished), window).messages()) == sent()[since:until]


def test_chunks_outside_are_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, opened = recording(tmp_path), []
    from milepost.recorder import reading

    whole = reading.breakup_chunk
    monkeypatch.setattr(reading, "breakup_chunk", lambda chunk, **how: opened.append(chunk) or whole(chunk, **how))
    list(McapReader(path, Window(T0 + 5 * NS_PER_S, T0 + 9 * NS_PER_S)).messages())
    assert len(opened) == 4


@pytest.mark.parametrize(
    ("since", "until", "expected"),
    [
        (None, None, ALL),
        ("5", None, Window(T0 + 5 * NS_PER_S)),
        (None, "2.5", Window(until_ns=T0 + 5 * NS_PER_S // 2)),
        (
            "2026-11-28T12:15:00",
            "2026-11-28T13:15:00.5+01:00",
            Window(1795868100 * NS_PER_S, 1795868100 * NS_PER_S + 500_000_000),
        ),
    ],
)
def test_a_time_is_utc_or_seconds_after_the_first_message(
    tmp_path: Path, since: str | None, until: str | None, expected: Window
) -> None:
    assert window_of([recording(tmp_path)], since, until) == expected


@pytest.mark.parametrize(
    ("since", "until", "said"),
    [
        (
            "yesterday",
            None,
            "--since: must be UTC as in 2026-11-28T12:15:00, or seconds after the first message, not 'yesterday'",
        ),
        (None, "-5", "--until: must be UTC"),
        ("nan", None, "--since: must be UTC"),
        ("5", "5", "--until: 5 is not after --since 5"),
    ],
)
def test_what_is_no_time_or_no_span_is_refused_by_name(tmp_path: Path, since: str | None, until: str | None, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        window_of([recording(tmp_path)], since, until)
    assert str(caught.value).startswith(said)


def test_an_export_of_a_part_has_its_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = recording(tmp_path)
    assert run_export(path, tmp_path / "csv", None, None, "10", "13") == 0
    assert "3 messages -> " in capsys.readouterr().err
    assert run_export(path, tmp_path / "none", None, None, "100") == 1
    assert "nothing came between these times: it was recorded from 20" in capsys.readouterr().err


def test_an_export_leaves_no_table_of_an_earlier_one_in_its_folder(tmp_path: Path) -> None:
    """What is no table of ours stays."""
    path, folder = recording(tmp_path), tmp_path / "csv"
    folder.mkdir()
    (folder / "event.csv").write_text("of another recording\n")
    (folder / "notes.txt").write_text("mine\n")
    assert run_export(path, folder, None, None, "10", "13") == 0
    assert sorted(each.name for each in folder.iterdir()) == ["notes.txt", "speed_reading.csv"]
