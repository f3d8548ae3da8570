"""A headless Chromium, and when the page of `isobrick serve` in it has come to rest."""

from __future__ import annotations

import contextlib
import re
import shutil
from collections.abc import Iterator
from typing import Any

from playwright.sync_api import Browser, FrameLocator, Page, expect, sync_playwright

WAIT = 120_000  # milliseconds; the processor draws, and other tests run beside


@contextlib.contextmanager
def chromium(**options: Any) -> Iterator[Browser]:
    path = shutil.which("chromium")
    assert path, "tools/packages/release.txt has chromium"
    # Root needs the first; the others let the processor draw.
    words = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=words, **options)
        yield browser
        browser.close()


def settle(page: Page | FrameLocator) -> None:
    """Waits until the page shows the finest surface of what was wished."""
    two_frames = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    page.locator("body").evaluate(two_frames, timeout=WAIT)
    expect(page.locator("#status")).to_have_text(re.compile("· fine$"), timeout=WAIT)
    page.locator("body").evaluate(two_frames)
