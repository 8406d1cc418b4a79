"""The browser in which pages are opened, and the figures that are closed."""

import shutil

import matplotlib.pyplot as plt
import ngsolve as ngs
import pytest
from playwright.sync_api import sync_playwright

# Threads of the sparse solver spin while they wait, which holds up tests beside them.
ngs.SetNumThreads(1)


@pytest.fixture(scope="module")
def browser():
    names = ("chromium", "chromium-browser", "google-chrome")
    installed = next(filter(None, map(shutil.which, names)), None)
    with sync_playwright() as play:
        # Without an installed one, playwright looks for its own.
        chromium = play.chromium.launch(executable_path=installed, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(autouse=True)
def no_figures_left():
    """Figures of one test are none of the next one's, which may count them."""
    yield
    plt.close("all")
