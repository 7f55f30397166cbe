"""The page in a browser: drawn without errors in four sizes and colours, and driven by keyboard.

Skipped where Playwright or a Chromium is missing.
"""

import re
import shutil
import subprocess
import sys

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright, and Debian's chromium or its own")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(swept):
    program = [sys.executable, "-m", "maglev_workbench", "explore", "hmb_free", "--sweep", str(swept)]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, text=True)
    yield re.search(r"http\S+", process.stdout.readline() + process.stdout.readline()).group()
    process.terminate()
    process.wait(20)


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as running:
        try:
            chromium = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        except playwright.Error as error:
            pytest.skip(f"no Chromium: {error.message.splitlines()[0]}")
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser, address):
    pages = []

    def open_at(width=1400, colours="light"):
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=colours)
        page.said = []
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.goto(address)
        page.wait_for_selector("body[data-identified]", timeout=60_000)
        pages.append(page)
        return page

    yield open_at
    for page in pages:
        page.close()


def settled(page):
    page.wait_for_timeout(500)
    return page.inner_text("#answer")


@pytest.mark.parametrize("width", [1400, 420])
@pytest.mark.parametrize("colours", ["light", "dark"])
def test_it_is_drawn_without_errors_and_without_sideways_scroll(opened, width, colours):
    page = opened(width, colours)
    assert page.said == []
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert page.locator("#panels canvas").count() == 10 and "Stable" in page.inner_text("#answer")
    assert page.evaluate("[...document.querySelectorAll('input,select,button')].every(e => e.id || e.labels?.length)")


def test_a_slider_moves_by_keyboard_and_undo_takes_it_back(opened):
    page = opened()
    before, first = page.inner_text("#answer"), page.input_value("#field-kd")
    page.locator("#slider-kd").focus()
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    assert settled(page) != before and float(page.input_value("#field-kd")) > float(first)
    for _ in range(20):
        page.keyboard.press("Control+z")
    assert settled(page) == before and page.input_value("#field-kd") == first
    assert page.is_disabled("#undo") and page.said == []


def test_the_map_gives_gains_by_click_and_by_key_and_the_goal_answers(opened):
    page = opened()
    assert page.input_value("#field-kd") == "6" and page.locator(".bar").count() == 8
    box = page.locator("#map canvas").bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.2 * box["height"])
    settled(page)
    assert page.input_value("#field-kd") == "7" and page.input_value("#field-kp") == "10"
    page.locator("#map canvas").focus()
    page.keyboard.press("ArrowLeft")
    settled(page)
    assert page.input_value("#field-kp") == "8" and "kp 8 A/mm" in page.inner_text("#map .readout")
    page.click("#undo")
    page.click("#undo")
    settled(page)
    assert page.input_value("#field-kd") == "6"
    page.wait_for_selector(".bar[data-met=open]", state="detached", timeout=60_000)
    assert "of 8 requirements met" in page.inner_text("#goal summary") and page.said == []


def test_units_effects_and_what_is_wrong(opened):
    page = opened()
    assert page.input_value("#field-kp") == "8" and "N/mm" in page.inner_text("#answer")
    page.select_option("#units", "files")
    assert "N/m," in settled(page) and "N/mm" not in page.inner_text("#answer")
    assert "peak_sensitivity <= 3" in page.inner_text("#goal")  # as in its file
    assert page.input_value("#field-kp") == "8000" and "A/m" in page.get_attribute("#slider-kp", "aria-valuetext")
    page.check("#on-delay")
    page.fill("#field-delay-time", "3e-4")
    page.keyboard.press("Enter")
    settled(page)
    page.select_option("#copied", "command")
    page.click("#copy")
    settled(page)
    assert "--effect delay.time=0.0003" in page.input_value("#text")
    page.fill("#field-td", "-1")
    page.keyboard.press("Enter")
    settled(page)
    assert "td = -1" in page.inner_text("#error")
    assert page.locator("body.refused").count() == 1 and page.is_hidden("#text")  # which would be that of before
    page.click("#undo")
    settled(page)
    assert page.is_hidden("#error") and page.locator("body.refused").count() == 0 and page.said == []
