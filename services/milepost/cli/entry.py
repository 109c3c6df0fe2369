"""The command's entry point. Until its command line has been read, Ctrl-C ends it without a traceback."""

from __future__ import annotations

import signal


def main() -> None:
    """Run `milepost`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .main import main as run

    signal.signal(signal.SIGINT, signal.default_int_handler)
    run()
