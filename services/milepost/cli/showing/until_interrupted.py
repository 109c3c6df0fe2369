"""The end of a command that shows what comes."""

from __future__ import annotations

from collections.abc import Callable

from milepost.runtime.bus import NoRouterError
from milepost.runtime.logs.records import say


def until_interrupted(show: Callable[[], None]) -> int:
    """Show something until Ctrl-C, or until it ends; the exit code, 1 where there is no router."""
    try:
        show()
    except NoRouterError as error:
        say(str(error))
        return 1
    except KeyboardInterrupt:
        pass
    return 0
