"""The report in a real browser: it is drawn, sorts, fits, and asks the network for nothing."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from browser import chromium, webdriver
from report_graphs import doubted, large, named, posed
from rotavg import report

Image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    with chromium(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    solutions = {"named": named(), "posed": posed(folder), "large": large()}
    solutions["doubted"] = doubted()
    for name, solution in solutions.items():
        report.write_report(folder / f"{name}.html", solution, title=name)
    return {name: folder / f"{name}.html" for name in solutions}


def show(
    browser: webdriver.Chrome, page: Path, width: int = 1280, scheme: str = "light"
) -> list[str]:
    """Open the page, wait until all is drawn, and give what the browser complained of."""
    for log in ("browser", "performance"):
        browser.get_log(log)  # forget what was before
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    browser.get(page.as_uri())
    drawn = "return document.documentElement.classList.contains('drawn')"
    WebDriverWait(browser, 120).until(lambda driver: driver.execute_script(drawn))
    return [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def picture(browser: webdriver.Chrome, selector: str) -> NDArray[np.uint8]:
    png = browser.find_element(By.CSS_SELECTOR, selector).screenshot_as_base64
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB"))


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [
        ("named", 360, "light"),
        ("named", 1280, "dark"),
        ("posed", 360, "dark"),
        ("posed", 1280, "light"),
        ("large", 360, "dark"),
        ("large", 1280, "light"),
        ("doubted", 360, "light"),
        ("doubted", 1280, "dark"),
    ],
)
def test_it_is_drawn_and_fits(
    name: str, width: int, scheme: str, browser: webdriver.Chrome, pages: dict[str, Path]
) -> None:
    assert show(browser, pages[name], width, scheme) == []
    assert browser.title == f"rotavg: {name}"
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    text, page = browser.execute_script(
        "const s = getComputedStyle(document.body); return [s.color, s.backgroundColor]"
    )
    brightness = [sum(map(int, c[4:-1].split(","))) for c in (text, page)]
    assert (brightness[0] < 200 and brightness[1] > 600) == (scheme == "light")
    figures = ["space", "residuals", "convergence", "adjacency"]
    for figure in figures + ["weights"] * (name == "doubted"):
        selector = f"[data-figure={figure}]"
        shown = picture(browser, selector).reshape(-1, 3)
        paper = shown[0]
        ink = np.abs(shown.astype(int) - paper).max(axis=1) > 40
        assert 0.005 < ink.mean() < 0.9, figure
    # The colours of residuals are in space, not in the scale beside it alone.
    space = picture(browser, "[data-figure=space]").astype(int)
    space = space[:, : space.shape[1] * 7 // 10].reshape(-1, 3)
    assert (np.abs(space[:, 0] - space[:, 2]) > 60).mean() > 0.002


def test_it_asks_the_network_for_nothing(browser: webdriver.Chrome, pages: dict[str, Path]) -> None:
    show(browser, pages["posed"])
    asked = []
    for entry in browser.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            asked.append(message["params"]["request"]["url"].split(":")[0])
    assert set(asked) <= {"file", "data", "blob"}
    assert "file" in asked
    buttons = browser.execute_script(
        "return [...document.querySelectorAll('.modebar-btn')].map((b) => b.dataset.title)"
    )
    assert buttons
    assert not [title for title in buttons if "cloud" in title.lower()]


def column(browser: webdriver.Chrome, table: int, k: int) -> list[str]:
    found: list[str] = browser.execute_script(
        "return [...document.querySelectorAll('table.sortable')[arguments[0]].tBodies[0].rows]"
        ".map((row) => row.cells[arguments[1]].dataset.value ?? row.cells[arguments[1]].innerText)",
        table,
        k,
    )
    return found


def test_the_tables_sort(browser: webdriver.Chrome, pages: dict[str, Path]) -> None:
    show(browser, pages["named"])
    heads = browser.find_elements(By.CSS_SELECTOR, "table.sortable:first-of-type th button")
    edges = [h for h in heads if h.text.split(" ")[0] in ("from", "to", "residual", "weight")][:4]
    before = column(browser, 0, 2)
    assert [float(x) for x in before] == sorted(map(float, before), reverse=True)
    edges[2].click()  # numbers from the largest, then from the smallest
    assert column(browser, 0, 2) == before
    edges[2].click()
    assert column(browser, 0, 2) == before[::-1]
    rows = sorted(zip(column(browser, 0, 0), column(browser, 0, 1), column(browser, 0, 2)))
    edges[0].click()  # names: the number in them counts as one
    names = column(browser, 0, 0)
    numbers = [int(n.split(">")[1].split("<")[0]) for n in names if n.startswith("<b>")]
    assert numbers == sorted(numbers)
    assert len(numbers) > 100
    assert rows == sorted(zip(names, column(browser, 0, 1), column(browser, 0, 2)))  # rows hold
    sort = browser.execute_script(
        "return [...document.querySelectorAll('table.sortable th')].map((h) => h.ariaSort)"
    )
    assert sort[:3] == ["ascending", None, None]


def test_a_change_to_the_dark_redraws(browser: webdriver.Chrome, pages: dict[str, Path]) -> None:
    show(browser, pages["named"], scheme="light")
    title = "return getComputedStyle(document.querySelector('.xtick text')).fill"
    light = browser.execute_script(title)
    features = [{"name": "prefers-color-scheme", "value": "dark"}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    WebDriverWait(browser, 30).until(lambda driver: driver.execute_script(title) != light)
