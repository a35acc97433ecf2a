"""A browser without a window, for the tests of pages."""

import io
import os
import shutil
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image

_PATIENCE_MS = 120_000  # a busy machine draws without a graphics card
_LOOK_S = 0.4  # a look may be a picture of the page
_FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
_FLAGS += ["--no-sandbox", "--disable-dev-shm-usage"]

# Without a graphics card, drawing as often as it can be seen would take a core.
_FIVE_TIMES_A_SECOND = """window.requestAnimationFrame =
    draw => setTimeout(() => draw(performance.now()), 200);
window.cancelAnimationFrame = clearTimeout;"""


def chromium_path():
    """Where the system's Chromium is; without one the test is skipped, or fails in CI."""
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        assert os.environ.get("CI") != "true", "no Chromium is installed"
        pytest.skip("no Chromium is installed")
    return found


class Visit:
    """A page that is open, and what it has asked for.

    Attributes:
        page: of playwright.
        requests: addresses of all requests and websockets.
        errors: what its scripts have complained of.
    """

    def __init__(self, browser, size, scale):
        self.page = browser.new_page(
            viewport={"width": size[0], "height": size[1]}, device_scale_factor=scale
        )
        self.page.add_init_script(_FIVE_TIMES_A_SECOND)
        self.page.set_default_timeout(_PATIENCE_MS)
        self.requests, self.errors = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))

    def strangers(self, own):
        """Requests that left for elsewhere."""
        return [url for url in self.requests if not url.startswith((*own, "blob:", "data:"))]

    def pixels(self):
        """(h, w, 3) uint8 RGB of what is seen."""
        data = self.page.screenshot()
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def wait_for(self, condition, what, timeout_s=120.0):
        """Let the page go on until a condition holds."""
        for _ in range(int(timeout_s / _LOOK_S)):
            if condition():
                return
            self.page.wait_for_timeout(1000 * _LOOK_S)
        shown = self.page.inner_text("body")
        raise AssertionError(f"waited {timeout_s} s in vain for {what}; the page shows: {shown}")


@contextmanager
def visit(url, size=(1100, 800), path=None, scale=1):
    """Open a page, in the system's Chromium or another; in a window of a size in the page's
    pixels, each of ``scale`` real ones."""
    playwright = pytest.importorskip("playwright.sync_api")
    path = path or chromium_path()
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=_FLAGS)
        try:
            opened = Visit(browser, size, scale)
            opened.page.goto(url)
            yield opened
        finally:
            browser.close()
