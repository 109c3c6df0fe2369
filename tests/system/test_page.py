"""The dispatch page of a real train in a real browser: what it shows, what it follows, what it asks for."""

from __future__ import annotations

import os
import re
import shutil
import signal
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import psutil
import pytest
from test_feed import get, soon

from conftest import free_port, running, title_of

pytestmark = pytest.mark.long

pytest.importorskip("nicegui", reason="no nicegui: pip install 'milepost[page]'")
sync_api = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install 'milepost[browser]'")
CHROMIUM = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-proxy-server"]
IN_TIME_MS = 20_000
# any sixteen bytes in base64
KEY = "AAAAAAAAAAAAAAAAAAAAAA=="

if CHROMIUM is None:
    pytest.skip("no chromium: apt-get install chromium", allow_module_level=True)


@pytest.fixture(scope="module")
def train() -> Iterator[tuple[Any, Any, str]]:
    """The default train with its page; yields both and the page's address."""
    port = free_port()
    with running("full", "milepost/v1/full-1/state", "--page", str(port)) as (stack, outside):
        soon(lambda: _answers(port), 30.0, "an answer")
        assert any(f"the dispatch page is at http://127.0.0.1:{port}\n" in line for line in stack.errors)
        yield stack, outside, f"http://127.0.0.1:{port}"


def _answers(port: int) -> bool:
    try:
        return get(port, "/").status == 200
    except OSError:
        return False


@pytest.fixture
def tab() -> Iterator[Any]:
    """A tab of a headless browser; afterwards nothing may have failed in it or left this machine."""
    asked: list[str] = []
    failed: list[str] = []
    with sync_api.sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        page = browser.new_page()
        page.set_default_timeout(IN_TIME_MS)
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda socket: asked.append(socket.url))
        page.on("pageerror", lambda error: failed.append(str(error)))
        yield page
        browser.close()
    assert asked
    assert {urlsplit(url).hostname for url in asked if not url.startswith("data:")} == {"127.0.0.1"}
    assert failed == []


def text(tab: Any, field: str) -> str:
    found: str = tab.locator(f'#train [data-field="{field}"]').first.inner_text()
    return found


def test_the_overview_has_the_train_and_enter_opens_it(train, tab):
    """GIVEN a running train, WHEN its name is reached by keyboard and Enter is pressed, THEN its page opens."""
    _, _, address = train
    tab.goto(address)
    row = tab.locator("#trains tr")
    sync_api.expect(row).to_contain_text(re.compile(r"full-1\s*(normal|degraded)"))
    assert re.search(r"1 train: 1 (normal|degraded)", tab.locator("#summary").inner_text())
    tab.keyboard.press("Tab")
    assert tab.evaluate("document.activeElement.textContent") == "full-1"
    tab.keyboard.press("Enter")
    tab.wait_for_url("**/train/full-1")
    sync_api.expect(tab.locator("#train h1")).to_have_text("full-1")


def test_the_page_follows_the_train(train, tab):
    """GIVEN its page, WHEN the train runs for some seconds, THEN position, speed, age and the drawing follow its states."""
    _, outside, address = train
    tab.goto(f"{address}/train/full-1")
    sync_api.expect(tab.locator('#train [data-field="position"]')).to_have_text(re.compile(r"^\d+\.\d\d$"))
    seen, marker = [], []
    for _ in range(5):
        seen.append(float(text(tab, "position")))
        marker.append(tab.locator("#near .marker").get_attribute("d"))
        newest = outside.newest("milepost/v1/full-1/state")
        assert seen[-1] == pytest.approx(newest["position_m"], abs=30.0)
        tab.wait_for_timeout(1000.0)
    assert seen == sorted(set(seen))
    assert len(set(marker)) == len(marker)
    assert re.fullmatch(r"\d+\.\d", text(tab, "speed"))
    assert re.fullmatch(r"(< 1 s|[1-5] s) ago", text(tab, "age"))
    assert "inside the protected interval" in text(tab, "error")
    assert tab.locator("#line-note").inner_text() == "18.6 km, 18 balises, 2 tunnels, 3 stations"
    names = [each.text_content() for each in tab.locator("#whole text.name").all()]
    assert names == ["Airport", "Exhibition Centre", "City"]
    units = tab.locator("#units tr")
    assert units.count() >= 7
    sync_api.expect(tab.locator("#units tr", has_text="gnss")).to_contain_text("Hz")
    assert tab.locator("#plan .rail").get_attribute("d").count("L") > 100
    assert tab.locator("#speeds .curve").get_attribute("d").count("L") >= 5


def test_a_fault_that_is_injected_by_hand_is_shown_with_the_excluded_unit(train, tab):
    """GIVEN its page, WHEN a bias is injected into a radar there, THEN the radar is named as excluded, with the event.

    That it lies is the hypothesis that is published.
    """
    _, outside, address = train
    tab.goto(f"{address}/train/full-1")
    panel = tab.locator(".inject")
    panel.wait_for(state="visible")
    sync_api.expect(tab.locator("#hypotheses tr").first).to_contain_text(re.compile(r"nobody lies\s*published"))
    panel.get_by_label("Sensor").click()
    tab.get_by_role("option", name="radar-rear").click()
    panel.get_by_label("size").fill("5")
    panel.get_by_label("For (s)").fill("8")
    panel.get_by_role("button", name="Inject").click()
    sync_api.expect(panel.locator(".answer")).to_contain_text("bias (size 5) for 8 s")
    sync_api.expect(tab.locator('#train [data-field="excluded"]')).to_contain_text("radar-rear")
    sync_api.expect(tab.locator("#units tr", has_text="radar-rear")).to_contain_text("excluded")
    alone = tab.locator("#hypotheses tr", has_text=re.compile("^radar-rear lies(?!,)"))
    sync_api.expect(alone).to_contain_text("published")
    sync_api.expect(tab.locator("#events")).to_contain_text("fault injected")
    sync_api.expect(tab.locator("#events li", has_text="unit excluded").first).to_contain_text("What to do:")
    state = "milepost/v1/full-1/state"
    outside.wait_state(
        state, lambda m: all(each["unit"] != "radar-rear" for each in m["excluded"]), 60.0, "the radar in use again"
    )
    sync_api.expect(tab.locator("#units tr", has_text="radar-rear")).to_contain_text("in use")


def test_a_fault_for_no_time_is_not_injected(train, tab):
    """GIVEN 0 s, WHEN a fault is to be injected, THEN the page says what is wrong, and asks no sensor."""
    _, _, address = train
    tab.goto(f"{address}/train/full-1")
    panel = tab.locator(".inject")
    panel.wait_for(state="visible")
    panel.get_by_label("size").fill("5")
    panel.get_by_label("For (s)").fill("0")
    panel.get_by_role("button", name="Inject").click()
    sync_api.expect(panel.locator(".answer")).to_contain_text("must be greater than 0")


@pytest.mark.parametrize("width", [360, 1280])
@pytest.mark.parametrize("path", ["", "/train/full-1"])
def test_nothing_is_wider_than_the_screen(train, tab, width, path):
    _, _, address = train
    tab.set_viewport_size({"width": width, "height": 740})
    tab.goto(address + path)
    last = tab.locator("#units tr", has_text="radar-rear") if path else tab.get_by_text("full-1", exact=True)
    last.first.wait_for()
    # while the page is laid out its charts still have the width that they were made with
    tab.wait_for_function("width => document.documentElement.scrollWidth <= width", arg=width, timeout=5000.0)


def test_only_pages_of_this_server_are_answered(train):
    """A page from elsewhere, in the same browser, must neither read trains nor inject faults."""
    _, _, address = train
    port = urlsplit(address).port
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": KEY}
    own = {"Origin": address}
    assert get(port, "/live", headers={**upgrade, **own}).status == 101
    assert get(port, "/live", headers={**upgrade, "Origin": "http://elsewhere.example"}).status == 403
    assert get(port, "/", headers={"Host": "elsewhere.example"}).status == 400


def test_a_page_without_its_server_shows_no_figures_until_the_server_is_back(train, tab):
    """GIVEN its page, WHEN the server is killed, THEN no figure stays, and the page goes on when the server is back."""
    stack, _, address = train
    tab.goto(f"{address}/train/full-1")
    position = tab.locator('#train [data-field="position"]')
    sync_api.expect(position).to_have_text(re.compile(r"^\d+\.\d\d$"))
    # the severity of a past event stays true without the server; the first event is a wheel's diameter, after a hundred metres
    happened = tab.locator("#events .word")
    sync_api.expect(happened.first).to_have_text(re.compile("info|warning|error"), timeout=IN_TIME_MS)
    (pid,) = [each.pid for each in psutil.Process(stack.process.pid).children() if title_of(each.pid) == "milepost page"]
    os.kill(pid, signal.SIGKILL)
    sync_api.expect(position).to_have_text("unknown")
    sync_api.expect(tab.locator("#link")).to_be_visible()
    sync_api.expect(tab.locator('#train [data-field="meaning"]')).to_have_text("unknown")
    assert set(tab.locator("#hypotheses .number").all_text_contents()) == {"unknown"}
    assert "unknown" not in happened.all_text_contents()
    sync_api.expect(position).to_have_text(re.compile(r"^\d+\.\d\d$"), timeout=40_000)
    sync_api.expect(tab.locator("#link")).to_be_hidden()
    assert "unknown" not in happened.all_text_contents()
