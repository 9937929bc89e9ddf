"""Debian's chromium, steered by Selenium, with nothing but the page under test to talk to."""

from __future__ import annotations

import shutil
import tempfile
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from selenium.webdriver import Chrome, ChromeOptions, ChromeService

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-dev-shm-usage", "--hide-scrollbars"),
)
PATIENCE_S = 60.0


class Page:
    """One browser window."""

    def __init__(self, driver: Chrome) -> None:
        self.driver = driver

    def js(self, code: str, *arguments: Any) -> Any:
        return self.driver.execute_script(f"return {code}", *arguments)

    def text(self, element: str) -> str:
        return str(self.js("(document.getElementById(arguments[0]) || {}).textContent || ''", element))

    def click(self, element: str) -> None:
        self.driver.find_element("id", element).click()

    def view(self, name: str) -> None:
        self.driver.find_element("css selector", f'nav button[data-view="{name}"]').click()

    def until(self, what: Callable[[], Any], why: str, patience_s: float = PATIENCE_S) -> Any:
        end = time.monotonic() + patience_s
        while True:
            found = what()
            if found:
                return found
            if time.monotonic() > end:
                seen = [self.text(each) for each in ("link", "state", "said", "alert")]
                raise AssertionError(f"{why}; {seen}; {self.complaints()}")
            time.sleep(0.05)

    def until_text(self, element: str, part: str, patience_s: float = PATIENCE_S) -> None:
        try:
            self.until(lambda: part in self.text(element), f"#{element} never said {part!r}", patience_s)
        except AssertionError as error:
            raise AssertionError(f"{error}; it says {self.text(element)!r}") from None

    def put(self, element: str, value: str) -> None:
        """Type into a field as a person does."""
        field = self.driver.find_element("id", element)
        field.clear()
        field.send_keys(value)

    def complaints(self) -> list[str]:
        """What the console has told since the last call."""
        return [
            each["message"]
            for each in self.driver.get_log("browser")
            if each["level"] in {"SEVERE", "WARNING"}
        ]

    def picture(self, path: Path) -> None:
        self.driver.save_screenshot(str(path))


@contextmanager
def chromium(width: int = 1280, height: int = 860, *more: str) -> Iterator[Page]:
    """A browser with an empty profile; it is gone afterwards."""
    driver_path = shutil.which("chromedriver")
    assert driver_path, "apt-get install chromium chromium-driver"
    options = ChromeOptions()
    options.binary_location = shutil.which("chromium") or "chromium"
    with tempfile.TemporaryDirectory(prefix="seod-chromium-") as profile:
        for flag in (*FLAGS, f"--user-data-dir={profile}", f"--window-size={width},{height}", *more):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        driver = Chrome(options=options, service=ChromeService(driver_path))
        try:
            yield Page(driver)
        finally:
            driver.quit()
