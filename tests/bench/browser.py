"""A real browser on the dispatch page: when which position stands on it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# the first frames are those of opening
OPENS_MS = 3000.0
# [row, text, milliseconds of the clock] of every position that changes; when anything changed
WATCH = """() => {
  window.shown = []; window.frames = 0;
  new MutationObserver((all) => { window.frames += 1;
    for (const each of all) if (each.target.dataset?.field === "position") {
      const row = each.target.closest("tr")?.querySelector("a")?.textContent ?? "";
      window.shown.push([row, each.target.textContent, performance.timeOrigin + performance.now()]);
    }
  }).observe(document.body, { childList: true, subtree: true });
}"""


@contextmanager
def browsing() -> Iterator[Any]:
    """A headless browser; the tab of an address is `watched`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as tool:
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = tool.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-proxy-server"]
        )
        yield browser
        browser.close()


def watched(browser: Any, address: str) -> Any:
    """A tab that shows an address, and notes from now on what it shows."""
    tab = browser.new_page()
    tab.goto(address)
    tab.wait_for_timeout(OPENS_MS)
    tab.evaluate(WATCH)
    return tab


def seen(tab: Any) -> tuple[list[tuple[str, str, float]], int]:
    """What was noted of the positions, and how many frames changed something."""
    shown, frames = tab.evaluate("[window.shown, window.frames]")
    return [(row, text, at_ms) for row, text, at_ms in shown], frames
