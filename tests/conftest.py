"""The browser in which pages are opened."""

import shutil

import pytest
from playwright.sync_api import sync_playwright


@pytest.fixture(scope="module")
def browser():
    names = ("chromium", "chromium-browser", "google-chrome")
    installed = next(filter(None, map(shutil.which, names)), None)
    with sync_playwright() as play:
        # Without an installed one, playwright looks for its own.
        chromium = play.chromium.launch(executable_path=installed, args=["--no-sandbox"])
        yield chromium
        chromium.close()
