"""The command's entry point. Until its command line has been read, Ctrl-C just ends it, without a traceback."""

from __future__ import annotations

import signal


def main() -> None:
    """Run `milepost`. From when its command begins, Ctrl-C is KeyboardInterrupt: see `main.milepost`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .main import main as run

    run()
