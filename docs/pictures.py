"""Draw the pictures of the documents (`make pictures`): the table and the page of live runs, the plots of scenarios."""

from __future__ import annotations

import io
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image
from rich.console import Console

from milepost.cli.showing.watch import STREAMS, Screen
from milepost.runtime.listening import listening

FOLDER = Path(__file__).resolve().parent / "pictures"
SCENARIO = "odometer-radar"
# the front wheel of the default train spins from 75 to 79 s
RUN_S = 77.0
# the documents whose scenario is drawn under its name
DOCUMENTS = ("explanation/time.md", "explanation/hypotheses.md")
COLUMNS = 100
# an octree keeps the colours of thin lines; with fewer than 256 those of the statuses, which are rare, become others
PLOT_COLOURS = {"colors": 128, "method": Image.Quantize.FASTOCTREE}
PAGE_COLOURS = {"colors": 256, "kmeans": 1}
# by name: width and height of the screen, and whether it is dark
SCREENS = {
    "light": (1280, 800, False),
    "dark": (1280, 800, True),
    "360": (360, 740, False),
    "wide": (2560, 1440, True),
}

# rich's own template without its web fonts: the picture loads nothing from elsewhere
SVG = """\
<svg class="rich-terminal" viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">
<style>
.{unique_id}-matrix {{ font-family: ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", monospace;
  font-size: {char_height}px; line-height: {line_height}px; font-variant-east-asian: full-width; }}
.{unique_id}-title {{ font-size: 18px; font-weight: bold; font-family: sans-serif; }}
{styles}
</style>
<defs>
<clipPath id="{unique_id}-clip-terminal"><rect x="0" y="0" width="{terminal_width}" height="{terminal_height}" /></clipPath>
{lines}
</defs>
{chrome}
<g transform="translate({terminal_x}, {terminal_y})" clip-path="url(#{unique_id}-clip-terminal)">
{backgrounds}
<g class="{unique_id}-matrix">
{matrix}
</g>
</g>
</svg>
"""


def draw_table(path: Path) -> None:
    """Draw the live table of the default train, `RUN_S` after its first state."""
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    up = [sys.executable, "-m", "milepost", "up", "--headless", "--listen", endpoint]
    process = subprocess.Popen(up, stderr=subprocess.DEVNULL)
    screen = Screen()
    try:
        wait_for(port)
        with listening([endpoint], STREAMS, "*", screen.receive):
            while not screen.states:
                time.sleep(0.1)
            time.sleep(RUN_S)
            console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True)
            console.print(screen.render())
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()
    path.write_text(console.export_svg(title="milepost up", code_format=SVG, unique_id="milepost"), encoding="utf-8")


def free_port() -> int:
    """A port on which nothing listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def wait_for(port: int) -> None:
    """Return once something listens on the port."""
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            return
        except ConnectionRefusedError:
            time.sleep(0.1)
    raise TimeoutError(f"nothing listens on port {port}")


def draw_plot(scenario: str, path: Path) -> None:
    """Draw the errors of a scenario."""
    evaluate(scenario, "--plot", str(path))
    shrink(path, **PLOT_COLOURS)


def draw_document(document: Path, folder: Path) -> None:
    """Draw the errors of the scenario that a document shows, as its command does."""
    ((name, text),) = re.findall(r'```yaml title="([\w-]+)\.yaml"\n(.*?)```', document.read_text(encoding="utf-8"), re.S)
    with tempfile.TemporaryDirectory() as there:
        scenario = Path(there) / f"{name}.yaml"
        scenario.write_text(text, encoding="utf-8")
        draw_plot(str(scenario), folder / f"{name}.png")


def draw_wheels(path: Path) -> None:
    """Draw what is learned of two wheels, from the report of a scenario."""
    with tempfile.TemporaryDirectory() as there:
        evaluate(SCENARIO, "--report", there)
        shutil.copy(Path(there) / f"{SCENARIO}.diameter.png", path)
    shrink(path, **PLOT_COLOURS)


def evaluate(*words: str) -> None:
    """Run `milepost evaluate`."""
    subprocess.run([sys.executable, "-m", "milepost", "evaluate", *words], check=True)


def shrink(path: Path, **how: int) -> None:
    """Few colours keep the file small."""
    with Image.open(path) as image:
        image.convert("RGB").quantize(dither=Image.Dither.NONE, **how).save(path, optimize=True)


def draw_dispatch_page(
    folder: Path, trains: Sequence[str] = ("full", "metro"), pages: Sequence[str] = ("train", "trains")
) -> None:
    """Draw the dispatch page, the first picture while a wheel spins; needs chromium and the extra `browser`.

    One tab at a time: several that are drawn ten times a second starve each other on a small machine.
    """
    from playwright.sync_api import sync_playwright

    port, web = free_port(), free_port()
    up = [sys.executable, "-m", "milepost", "up", "--headless", "--listen", f"tcp/127.0.0.1:{port}", "--page", str(web)]
    process = subprocess.Popen([*up, *(word for train in trains for word in ("--train", train))], stderr=subprocess.DEVNULL)
    paths = {"train": "/train/full-1", "trains": "/"}
    try:
        wait_for(web)
        with sync_playwright() as tool:
            browser = tool.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"])
            for what in pages:
                for name, (width, height, dark) in SCREENS.items():
                    size = {"width": width, "height": height}
                    tab = browser.new_page(viewport=size, color_scheme="dark" if dark else "light")
                    tab.goto(f"http://127.0.0.1:{web}{paths[what]}", timeout=60e3)
                    first = what == pages[0] and name == next(iter(SCREENS))
                    tab.get_by_text("degraded" if first else "full-1", exact=True).first.wait_for(timeout=4e3 * RUN_S)
                    tab.wait_for_timeout(1e3 if first else 5e3)
                    file = folder / f"page-{what}-{name}.png"
                    # of a wall screen what it shows at once
                    tab.screenshot(path=file, full_page=what == "train" and name != "wide")
                    shrink(file, **PAGE_COLOURS)
                    tab.close()
            browser.close()
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    draw_table(FOLDER / "table.svg")
    draw_plot(SCENARIO, FOLDER / "errors.png")
    draw_wheels(FOLDER / "wheel-diameter.png")
    for shown in DOCUMENTS:
        draw_document(FOLDER.parent / shown, FOLDER)
    draw_dispatch_page(FOLDER)
