"""What a command says beside its output."""

from __future__ import annotations

from milepost.runtime.logs.records import say as say
