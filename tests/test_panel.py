"""The panel's page in a real browser: every control, and what it shows when things go wrong.

With SEOD_PICTURES=FOLDER the pictures of docs/panel.md are taken.
"""

from __future__ import annotations

import os
import re
import signal
import time
import urllib.request
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from selenium.webdriver import ActionChains, Keys
from selenium.webdriver.support.ui import Select

from tests.chromium import Page, chromium
from tests.panel_rig import PanelRig, panel_daemon
from tests.peers import kill

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.processes

PICTURES = os.environ.get("SEOD_PICTURES")
PAGE_BYTES = 300_000
JOB_PATIENCE_S = 240.0
RECORDED_ROWS = 1000
DIAGNOSED_TICKS = 8000
"""Four seconds at 2 kHz: all that is diagnosed is of one excitation."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelRig]:
    with panel_daemon(tmp_path_factory.mktemp("panel")) as running:
        yield running


@pytest.fixture(scope="module")
def window() -> Iterator[Page]:
    with chromium() as opened:
        yield opened


@pytest.fixture
def page(rig: PanelRig, window: Page) -> Iterator[Page]:
    """The page, live, with the rig at rest; afterwards nothing may have been complained of."""
    window.driver.get("about:blank")  # another address: the page is loaded anew
    window.driver.get(rig.url)
    window.until(lambda: window.text("link") == "live", "never live")
    window.until(lambda: window.js("document.querySelectorAll('#settings input').length"), "no settings")
    at_rest(window)
    window.complaints()
    yield window
    assert window.complaints() == []


def at_rest(page: Page) -> None:
    """Out of a fault, and idle."""
    page.until(lambda: page.text("state") in {"idle", "fault", "holding", "exciting"}, "no state")
    if page.text("state") == "fault":
        take_over(page)
        page.click("reset")
    elif page.text("state") == "exciting":
        page.click("stop")
    page.until(lambda: page.text("state") == "idle", "not at rest")


def take_over(page: Page) -> None:
    if page.js("!document.getElementById('take').disabled"):
        page.click("take")
    page.until_text("commander", "You command")


def excite(page: Page) -> None:
    page.until(lambda: started(page), "the relay does not start")


def started(page: Page) -> bool:
    """Whether it is excited; a start that comes before the first sample is refused, and tried again."""
    if page.text("state") == "exciting":
        return True
    page.js("document.getElementById('said').textContent = ''")
    page.click("start")
    page.until(lambda: page.text("said"), "start is not answered")
    return page.text("said") == "start: done"


def picture(page: Page, name: str) -> None:
    if PICTURES:
        page.picture(Path(PICTURES) / f"{name}.png")


def scope_pixels(page: Page) -> int:
    """How many pixels of the first strip are neither ground nor grid: what is drawn."""
    drawn: int = page.js(
        """(() => { const c = document.querySelector('.strip canvas'); if (!c) return 0;
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data, seen = new Map();
        for (let k = 0; k < d.length; k += 4) { const key = d[k] << 16 | d[k+1] << 8 | d[k+2];
          seen.set(key, (seen.get(key) || 0) + 1); }
        return d.length / 4 - Math.max(...seen.values()); })()"""
    )
    return drawn


def test_the_page_is_small_and_talks_to_nobody_else(rig: PanelRig, page: Page) -> None:
    loaded: list[list[Any]] = page.js(
        "performance.getEntriesByType('resource').map((each) => [each.name, each.decodedBodySize])"
    )
    assert {name.split("/static")[0].split("/api")[0] for name, _ in loaded} == {rig.url}
    size = sum(size for _, size in loaded) + len(rig.ask("/", cookie="")[2])
    paint = page.js("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    print(f"page {size / 1000:.0f} kB, first paint after {paint:.0f} ms")
    assert size < PAGE_BYTES
    assert page.text("simulated") == "SIMULATED"
    assert page.js("!document.getElementById('simulated').hidden")


def test_controls_command_the_rig_within_its_limits(rig: PanelRig, page: Page) -> None:
    excite(page)
    page.until_text("now-quality", "ok")
    assert abs(float(page.text("now-zeta").split()[0]) - 0.21) < 0.02
    for name, value in (("e_a", "0.6"), ("hysteresis", "0.005"), ("bias", "0.01"), ("K_L", "18")):
        page.put(f"set-{name}", value)
    page.driver.find_element("id", "set-two_phase").click()
    Select(page.driver.find_element("id", "set-method")).select_by_visible_text("exact")
    page.click("set")
    page.until(lambda: page.text("said") == "set", "not set")
    rpc = rig.rpc()
    try:
        settings = rpc.call("get", axis="motor")["settings"]
        wanted = {"e_a": 0.6, "hysteresis": 0.005, "bias": 0.01, "K_L": 18.0, "method": "exact"}
        assert wanted.items() <= settings.items()
        page.put("set-e_a", "5")
        page.click("set")
        page.until_text("said", "limits.output")
        assert rpc.call("get", axis="motor")["settings"]["e_a"] == 0.6
    finally:
        back = {"e_a": 0.5, "hysteresis": 0.004, "bias": 0.0, "K_L": 17.0, "two_phase": False}
        rpc.call("set", axis="motor", **back)
        rpc.close()
    page.put("set-e_a", "0.5")
    Select(page.driver.find_element("id", "set-method")).select_by_visible_text("wave")
    page.click("set")
    page.until(lambda: page.text("said") == "set", "not set")
    page.click("stop")
    page.until(lambda: page.text("state") == "idle", "not stopped")
    page.click("release")
    page.until_text("commander", "Nobody commands")


def test_scope_runs_is_triggered_and_keeps_the_past(page: Page) -> None:
    excite(page)
    page.until(lambda: scope_pixels(page) > 2000, "nothing is drawn")
    page.until(lambda: page.js("Number(document.documentElement.dataset.frames || 0)") > 5, "no frames")
    time.sleep(2 if PICTURES else 0)
    picture(page, "panel-scope")
    for mode in ("on the relay's switches", "one shot"):
        Select(page.driver.find_element("id", "mode")).select_by_visible_text(mode)
        page.until(lambda: scope_pixels(page) > 1000, f"no sweep {mode}")
    Select(page.driver.find_element("id", "mode")).select_by_visible_text("free running")
    page.click("pause")
    page.until(lambda: page.js("document.querySelectorAll('#past canvas').length"), "no past")
    page.click("zoom-in")
    over = page.driver.find_element("css selector", "#past .u-over")
    ActionChains(page.driver).move_to_element_with_offset(over, -100, 0).click().perform()
    page.until_text("cursors", "A: t =")
    chain = ActionChains(page.driver).move_to_element_with_offset(over, 100, 0)
    chain.key_down(Keys.SHIFT).click().key_up(Keys.SHIFT).perform()
    page.until_text("cursors", "dt =")
    page.click("zoom-out")
    page.click("whole")
    page.click("pause")
    page.until(lambda: scope_pixels(page) > 2000, "it does not go on")


def test_views_show_estimates_cycle_model_and_health(page: Page) -> None:
    excite(page)
    page.until_text("now-quality", "ok")
    page.view("trends")
    page.until(lambda: page.js("document.querySelectorAll('#trend-zeta canvas').length"), "no trend")
    page.view("cycle")
    page.until_text("portrait-text", "omega_n")
    picture(page, "panel-cycle")
    page.view("model")
    page.until_text("model-now", "of the movement")
    page.view("health")
    page.until_text("latencies", "lateness")
    page.until_text("counts", "overruns")
    assert "state" in page.text("events")
    page.view("trends")
    page.until(lambda: page.js("document.querySelectorAll('#trend-zeta canvas').length"), "no trend")
    time.sleep(3 if PICTURES else 0)
    picture(page, "panel-trends")


def test_estop_by_click_and_by_key_wherever_one_is(page: Page) -> None:
    for press in (
        lambda: page.click("estop"),
        lambda: page.driver.find_element("id", "set-e_a").send_keys(Keys.ESCAPE),
    ):
        at_rest(page)
        excite(page)
        page.view("rigfile")
        press()
        page.until(lambda: page.text("state") == "fault", "not stopped")
        page.until_text("alert", "estop")
    at_rest(page)


def test_one_commands_and_is_taken_over_openly(rig: PanelRig, page: Page) -> None:
    excite(page)
    page.until_text("commander", "You command")
    driver = page.driver
    first = driver.current_window_handle
    driver.switch_to.new_window("tab")
    driver.get(rig.url)
    page.until(lambda: page.js("document.querySelectorAll('#settings input').length"), "no settings")
    page.until_text("commander", "commands")
    page.click("start")
    page.until_text("said", "take over first")
    page.click("stop")  # everybody may
    page.until(lambda: page.text("state") == "idle", "not stopped")
    page.click("take")
    page.until_text("commander", "You command")
    driver.switch_to.window(first)
    page.until_text("who", "commands")
    page.view("health")
    page.until_text("events", "taken over from")
    driver.switch_to.window(driver.window_handles[1])
    driver.close()
    driver.switch_to.window(first)
    page.until_text("commander", "Nobody commands")


def test_comes_back_when_the_gateway_is_killed(rig: PanelRig, page: Page) -> None:
    excite(page)
    kill(rig.child("seod.gateway"), signal.SIGKILL)
    page.until_text("link", "the gateway is gone")
    assert page.js("document.body.classList.contains('stale')")
    page.until(lambda: page.text("link") == "live", "never live again")
    page.until_text("alert", "gateway_died")
    at_rest(page)
    excite(page)


def test_what_is_stale_is_shown_as_stale(rig: PanelRig, page: Page) -> None:
    panel = rig.child("seod.panel")
    kill(panel, signal.SIGSTOP)
    try:
        page.until_text("link", "stale: the panel is silent")
    finally:
        kill(panel, signal.SIGCONT)
    page.until(lambda: page.text("link") == "live", "never live again")
    loop = rig.child("seod.loop")
    kill(loop, signal.SIGKILL)
    page.until_text("link", "stale: no rows")
    page.until_text("alert", "loop_died")
    take_over(page)
    page.click("reset")
    page.until(lambda: page.text("link") == "live", "no new loop")


def test_comes_back_when_the_panel_itself_is_killed(rig: PanelRig, page: Page) -> None:
    kill(rig.child("seod.panel"), signal.SIGKILL)
    page.until_text("link", "stale")
    page.until(lambda: page.text("link") == "live", "never live again")
    page.complaints()  # that it did not answer meanwhile


def test_records_lists_and_replays(rig: PanelRig, page: Page) -> None:
    excite(page)
    page.view("recordings")
    page.click("record")
    rows = lambda: int((re.findall(r"(\d+) rows, 0 lost", page.text("recorder")) or ["0"])[0])  # noqa: E731
    page.until(lambda: rows() > RECORDED_ROWS, "nothing is recorded")
    page.click("record")
    page.until_text("recorder", "Nothing is recorded")
    page.until(lambda: page.js("document.querySelectorAll('#recordings button').length") == 2, "not listed")
    page.driver.find_element("css selector", "#recordings button").click()
    page.until(lambda: page.js("document.querySelectorAll('#recording-job canvas').length"), "no replay")
    name = page.driver.find_element("css selector", "#recordings a").text
    session = rig.session()
    status, headers, _ = rig_bytes(rig, f"/api/recordings/{name}", session["cookie"])
    assert status == 200
    assert name in headers["content-disposition"]


def rig_bytes(rig: PanelRig, path: str, cookie: str) -> tuple[int, dict[str, str], int]:
    with urllib.request.urlopen(urllib.request.Request(rig.url + path, headers={"cookie": cookie})) as answer:
        return answer.status, {k.lower(): v for k, v in answer.headers.items()}, len(answer.read())


def test_rig_file_is_checked_helped_with_and_saved(rig: PanelRig, page: Page) -> None:
    page.view("rigfile")
    page.until(lambda: len(page.js("document.getElementById('rig-text').value")) > 1000, "no rig file")
    text = rig.rig_file.read_text()
    page.js(
        """(() => { const t = document.getElementById('rig-text'), k = t.value.indexOf('hysteresis:');
        t.focus(); t.setSelectionRange(k, k); t.dispatchEvent(new Event('keyup')); })()"""
    )
    page.until_text("rig-help", "relay.hysteresis: ")
    assert "no help" not in page.text("rig-help")
    page.click("rig-check")
    page.until_text("rig-said", "is right")
    edit(page, "hysteresis: ", "hysterisis: ")
    page.click("rig-save")
    page.until_text("rig-said", "did you mean 'hysteresis'")
    assert rig.rig_file.read_text() == text
    edit(page, "hysterisis: ", "hysteresis: ")
    edit(page, "cycles: 4", "cycles: 5")
    page.click("rig-save")
    page.until_text("rig-said", "next start")
    assert rig.rig_file.read_text() == text.replace("cycles: 4", "cycles: 5")


def edit(page: Page, old: str, new: str) -> None:
    page.js(
        "((old, now) => { const t = document.getElementById('rig-text');"
        "t.value = t.value.replace(old, now); })(arguments[0], arguments[1])",
        old,
        new,
    )


@pytest.mark.timeout(400)
def test_a_frequency_response_is_measured_from_the_page(page: Page) -> None:
    at_rest(page)
    take_over(page)
    page.view("cycle")
    page.driver.find_element("css selector", "#bode-form button").click()
    page.until_text("bode-said", "Fit: zeta", JOB_PATIENCE_S)
    zeta, omega_n = (
        float(each) for each in re.findall(r"(?:zeta|omega_n) ([0-9.]+)", page.text("bode-said"))
    )
    assert abs(zeta - 0.21) < 0.02
    assert abs(omega_n - 117.0) < 3.0
    assert page.js("document.querySelectorAll('#bode canvas').length") == 2
    picture(page, "panel-bode")


@pytest.mark.timeout(600)
def test_the_last_seconds_are_diagnosed_from_the_page(rig: PanelRig, page: Page) -> None:
    excite(page)
    page.until_text("now-quality", "ok")
    rpc = rig.rpc()
    try:
        begun = rpc.call("status")["health"]["ticks"]
        page.until(
            lambda: rpc.call("status")["health"]["ticks"] - begun > DIAGNOSED_TICKS, "too little is excited"
        )
    finally:
        rpc.close()
    page.view("model")
    seconds = page.driver.find_element("css selector", "#diagnose [name=seconds]")
    seconds.clear()
    seconds.send_keys("4")
    page.driver.find_element("css selector", "#diagnose button").click()
    page.until(lambda: page.js("document.querySelectorAll('#job progress').length"), "no progress")
    page.until_text("job", "held-out error", JOB_PATIENCE_S)
    assert "The model misses" in page.text("verdict")
    links = page.js("[...document.querySelectorAll('#job a')].map((each) => each.getAttribute('href'))")
    assert any(link.endswith("report.html") for link in links)
    cookie = rig.session()["cookie"]
    for link in links:
        status, _, size = rig_bytes(rig, link, cookie)
        assert (status, size > 1000) == (200, True)
    picture(page, "panel-diagnosis")


def test_on_a_phone_in_dark_and_light(rig: PanelRig, page: Page) -> None:
    driver = page.driver
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": 390, "height": 800, "deviceScaleFactor": 2, "mobile": True},
    )
    try:
        for _ in range(2):
            assert page.js("document.documentElement.scrollWidth") <= 390
            seen = page.js(
                "(() => { const r = document.getElementById('estop').getBoundingClientRect();"
                "return r.top >= 0 && r.bottom <= innerHeight && r.left >= 0 && r.right <= innerWidth; })()"
            )
            assert seen
            assert faint(page) == []
            picture(page, "panel-phone")
            page.click("theme")
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def faint(page: Page) -> list[str]:
    """Texts whose contrast with their ground is below 4.5, as WCAG AA wants it."""
    found: list[str] = page.js(
        """(() => {
        const parse = (c) => (c.match(/[\\d.]+/g) || []).map(Number);
        const light = (c) => { const [r, g, b] = c.map((v) => { v /= 255;
          return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; });
          return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
        const ground = (e) => { for (; e; e = e.parentElement) {
          const c = parse(getComputedStyle(e).backgroundColor);
          if (c.length === 3 || c[3] === 1) return c; } return [255, 255, 255]; };
        const out = [];
        for (const e of document.querySelectorAll('body *')) {
          const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
          if (!own || !e.getClientRects().length || e.disabled || e.tagName === 'OPTION') continue;
          const a = light(parse(getComputedStyle(e).color)), b = light(ground(e));
          const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
          if (contrast < 4.5) out.push(`${e.tagName} ${e.textContent.slice(0, 30)} ${contrast.toFixed(2)}`);
        }
        return out; })()"""
    )
    return found
