"""The page in Debian's Chromium, without a network, drawn by software."""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

CHROMIUM = "/usr/bin/chromium"
FLAGS = (
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
SIZE = (1280, 720)
LONG = 120_000
"""ms, on a machine that does other things, too."""


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser; the test is skipped where it, or playwright, is missing."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if shutil.which(CHROMIUM) is None:
        pytest.skip(f"{CHROMIUM} is not installed")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS), timeout=LONG)
        yield browser
        browser.close()


class Tab:
    """An open page. What it asked for and what it complained about is in `requests` and `complaints`."""

    def __init__(self, browser: Any, file: Path | str, address: str = "", scheme: str = "dark") -> None:
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]}, color_scheme=scheme)
        self.page.set_default_timeout(LONG)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self._heard(message))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto((file if isinstance(file, str) else file.as_uri()) + address)
        self.wait("document.documentElement.dataset.ready === 'true'")

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning") and "GPU stall due to ReadPixels" not in message.text:
            self.complaints.append(message.text)

    def ask(self, script: str) -> Any:
        return self.page.evaluate(script)

    def wait(self, condition: str) -> None:
        """Until a condition holds. (Playwright's own way evaluates text in the page, which the page's rules forbid.)"""
        for _ in range(LONG // 50):
            if self.ask(condition):
                return
            time.sleep(0.05)
        raise AssertionError(f"it never came to {condition}")

    def at(self, moment: float) -> None:
        """Go to a time and wait for the picture."""
        self.ask(f"cosim.seek({moment!r})")
        self.drawn()

    def drawn(self) -> None:
        self.ask("cosim.drawn()")

    def picture(self, element: str = "#stage") -> np.ndarray[Any, Any]:
        """Pixels (rows, columns, RGB) from 0 to 1 of an element."""
        from matplotlib.image import imread

        self.drawn()
        return np.asarray(imread(io.BytesIO(self.page.locator(element).screenshot()), format="png"))[:, :, :3]
