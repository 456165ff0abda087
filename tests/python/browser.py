"""A real browser without a window: Debian's chromium, driven through Selenium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

exceptions = pytest.importorskip(
    "selenium.common.exceptions", reason="selenium is not installed: pip install rotavg[test]"
)
webdriver = pytest.importorskip(
    "selenium.webdriver", reason="selenium is not installed: pip install rotavg[test]"
)

WebDriverException = exceptions.WebDriverException

SWITCHES = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # WebGL by the processor
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # whatever a page asks the network for, it fails
)


@contextmanager
def chromium(profile: Path) -> Iterator[webdriver.Chrome]:
    """A browser with a fresh profile; the test is skipped where there is none."""
    programs = [shutil.which(name) for name in ("chromium", "chromedriver")]
    if None in programs:
        pytest.skip("no browser: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = str(programs[0])
    for switch in (*SWITCHES, f"--user-data-dir={profile}"):
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(executable_path=programs[1])
    try:
        driver = webdriver.Chrome(options=options, service=service)
    except WebDriverException as error:  # in a bare container, say, without a name for localhost
        pytest.skip(f"the browser does not start here: {str(error.msg).splitlines()[0]}")
    try:
        yield driver
    finally:
        driver.quit()
