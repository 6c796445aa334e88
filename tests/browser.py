"""A real browser for the tests that are marked `browser`: Chromium without a window, driven by Selenium."""

import io
import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SWITCHES = (
    "headless=new",
    "no-sandbox",
    "disable-gpu",
    "disable-quic",
    "no-first-run",
    "disable-background-networking",
)
SWITCHES += ("disable-background-networking", "disable-component-update", "disable-sync", "disable-dev-shm-usage")
# Seconds that a page may take. Where it is quick they cost nothing; on a machine of two cores that does much else, the
# workers of a live page, which have a low priority, have a twentieth of a core.
PATIENCE = 300.0


class Page:
    """A page in the browser.

    driver : Selenium's, for whatever is not here
    """

    def __init__(self, driver: Any):
        self.driver = driver
        self._errors: list[str] = []
        self._requests: list[str] = []

    def resize(self, width: int, height: int = 900) -> None:
        """Give the page this many pixels; a window could not be as narrow as a phone."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)

    def prefer(self, less_motion: bool = True, dark: bool = False) -> None:
        """State what the reader prefers of what is opened from now on: without less motion a page is animated all the
        time, which takes most of a core."""
        wanted = {"reduced-motion": "reduce" if less_motion else "no-preference"}
        wanted |= {"color-scheme": "dark" if dark else "light"}
        features = [{"name": f"prefers-{name}", "value": value} for name, value in wanted.items()]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})

    def open(self, place: str | Path) -> None:
        """Open a file or an address."""
        self.driver.get(place.resolve().as_uri() if isinstance(place, Path) else place)

    def run(self, script: str, *arguments: Any) -> Any:
        """What the body of a JavaScript function returns, whose `arguments` are these."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, script: str, *arguments: Any) -> Any:
        """What a script returns as soon as that is true; a test fails after `PATIENCE`."""
        return wait_for(lambda: self.run(script, *arguments), script)

    def wait_for_figures(self, count: int = 1) -> None:
        """Wait until so many figures of Bokeh are drawn, which takes until their document is idle."""
        self.wait(
            "const docs = window.Bokeh ? Bokeh.documents : [];"
            "const figures = docs.flatMap(d => [...d._all_models.values()].filter(m => m.type == 'Figure'));"
            "return figures.length >= arguments[0] && docs.every(d => d.is_idle)",
            count,
        )

    def picture(self) -> np.ndarray:
        """What is seen, as an array (height, width, 3) of colours from 0 to 255."""
        from PIL import Image

        return np.array(Image.open(io.BytesIO(self.driver.get_screenshot_as_png())).convert("RGB"))

    def errors(self) -> list[str]:
        """What the console has told of errors so far."""
        found = [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
        self._errors += found
        return self._errors

    def requests(self) -> list[str]:
        """The addresses that were asked for so far, but for those of data within the page."""
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                self._requests.append(message["params"]["request"]["url"])
        return [url for url in self._requests if not url.startswith(("data:", "blob:"))]


def wait_for(ready: Callable[[], Any], what: str) -> Any:
    """What `ready` returns as soon as that is true; a test fails after `PATIENCE`."""
    end = time.monotonic() + PATIENCE
    while not (found := ready()):
        if time.monotonic() > end:
            pytest.fail(f"after {PATIENCE:g} s this is still not so: {what}")
        time.sleep(0.05)
    return found


@contextmanager
def chromium(width: int = 1200, height: int = 900) -> Iterator[Page]:
    """A page of this size, without motion, in a fresh Chromium; a test without Selenium is skipped, and one without a
    browser fails.

    It fails as well where the console has told of an error by the end.
    """
    webdriver = pytest.importorskip("selenium.webdriver")
    binary = next(filter(None, map(shutil.which, BROWSERS)), None)
    driver_path = shutil.which("chromedriver")
    if binary is None or driver_path is None:
        pytest.fail(f"these tests need Chromium and chromedriver (found {binary} and {driver_path})")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for switch in (*SWITCHES, f"window-size={width},{height}"):
        options.add_argument(f"--{switch}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(driver_path))
    try:
        driver.set_script_timeout(PATIENCE)
        page = Page(driver)
        page.resize(width, height)
        page.prefer()
        yield page
        assert page.errors() == []
    finally:
        driver.quit()
