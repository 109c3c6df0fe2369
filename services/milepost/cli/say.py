"""What a command says beside its output."""

from __future__ import annotations

import sys


def say(sentence: str) -> None:
    """A sentence to whoever started the command."""
    print(f"milepost: {sentence}", file=sys.stderr, flush=True)
