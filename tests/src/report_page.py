"""Every report in a real browser, from the disk and without a network: Chromium, driven by Playwright.

report_page.py CHROMIUM FOLDER; FOLDER/NAME/report.html are the reports, and FOLDER/NAME.json what each must say. Pictures are
kept in the folder of ROTORTWIN_PICTURES, if it is set. Fails on an error on the console, an exception, any request besides the file, a page wider than the screen, and what axe
finds serious.
"""

import json
import os
import re
import sys
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM, FOLDER = sys.argv[1], Path(sys.argv[2]).absolute()
PICTURES = Path(os.environ["ROTORTWIN_PICTURES"]).absolute() if os.environ.get("ROTORTWIN_PICTURES") else None
PATIENCE_MS = 60_000
# The page itself, without data.
LIMIT_KB = 150


def opened(browser: Browser, name: str, width: int, scheme: str) -> tuple[Page, list[str]]:
    complaints: list[str] = []
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, offline=True)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    address = (FOLDER / name / "report.html").as_uri()
    page.on("console", lambda m: complaints.append(f"console: {m.text}") if m.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: complaints.append(f"exception: {error}"))
    page.on("request", lambda r: complaints.append(f"asked for {r.url}") if r.url != address and not r.url.startswith("data:") else None)
    page.goto(address)
    page.locator("footer").wait_for()
    return page, complaints


def looks(browser: Browser, name: str, expected: dict) -> None:
    # Each width and each colour scheme once.
    for width, scheme in ((390, "light"), (1600, "dark")):
        page, complaints = opened(browser, name, width, scheme)
        # As in print: collapsed sections are expanded.
        page.locator("details.whole").evaluate_all("all => all.forEach(one => { one.open = true; })")
        text = page.locator("body").inner_text()
        for words in expected["says"]:
            assert words in text, f"{name}: {words!r} is not in\n{text[:3000]}"
        plots = page.locator("figure.plot canvas").count()
        counts = {selector: page.locator(selector).count() for selector, _ in expected["least"]}
        assert counts and all(counts[selector] >= least > 0 for selector, least in expected["least"]), f"{name}: {counts}, {expected['least']}"
        # Each plot has a textual description.
        summaries = page.locator("figure.plot .canvas").evaluate_all("all => all.map(one => document.getElementById(one.getAttribute('aria-describedby')).textContent)")
        assert len(summaries) == plots and all(re.search(r"\d", one) or "no value" in one for one in summaries), summaries
        # So has each heat strip, and each set of lanes.
        strips = page.locator("figure.plot:has(.heat, .lanes)").evaluate_all("all => all.map(one => document.getElementById(one.getAttribute('aria-describedby')).textContent)")
        assert all(re.search(r"\d| nothing\.", one) for one in strips), strips
        # And a table of numbers below it, which the summary opens.
        for place in range(plots):
            figure = page.locator("figure.plot", has=page.locator("canvas")).nth(place)
            if figure.locator("table").count() == 0:
                figure.locator("summary").first.evaluate("one => one.click()")
                figure.locator("table tbody tr").first.wait_for(state="attached")
                figure.locator("summary").first.evaluate("one => one.click()")
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0, f"{name}: {wide} px wider than the screen of {width} px"
        if PICTURES:
            page.screenshot(path=PICTURES / f"{name}-{width}-{scheme}.png", full_page=True)
        found = Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
        serious = [one for one in found if one["impact"] in ("serious", "critical")]
        assert not serious, f"{name}, {width} px, {scheme}: " + json.dumps([(one["id"], one["nodes"][0]["html"]) for one in serious])
        if scheme == "dark":
            page.locator("details.whole").evaluate_all("all => all.forEach(one => { one.open = false; })")
            themes(page, name)
        assert not complaints, f"{name}: " + "\n".join(complaints)
        page.context.close()


# What is on paper: registered after the page's own listeners, it sees what they have made of the page when the browser prints.
ON_PAPER = """
  window.paper = null;
  window.addEventListener('beforeprint', () => {
    const light = (text) => { const found = text.match(/[\\d.]+/g).map(Number); return found.length > 3 && found[3] === 0 ? null : (found[0] + found[1] + found[2]) / 3; };
    const root = getComputedStyle(document.documentElement);
    window.paper = {
      scheme: root.colorScheme,
      text: light(root.color),
      folded: document.querySelectorAll('details.whole:not([open])').length,
      wholes: document.querySelectorAll('details.whole').length,
    };
  });
"""
# In the rules of paper: the lightness of every surface that is not part of a picture, and what is left of what only a screen can use.
SURFACES = """
  () => {
    // `rgb(1, 2, 3)`, `rgba(1, 2, 3, 0.4)`, or what a mix is: `color(srgb 0.1 0.2 0.3 / 0.4)`; what is under it is white.
    const light = (text) => {
      const [red, green, blue, cover = 1] = text.match(/[\\d.]+/g).map(Number);
      return cover * (red + green + blue) / 3 * (text.startsWith('color(') ? 255 : 1) + (1 - cover) * 255;
    };
    const all = [document.documentElement, document.body, ...document.querySelectorAll('main, .panel, .card, figure, table, td, pre')];
    return {
      darkest: Math.min(...all.map((one) => light(getComputedStyle(one).backgroundColor))),
      screen: [...document.querySelectorAll('.screen, header button')].filter((one) => one.checkVisibility()).length,
    };
  }
"""


def themes(page: Page, name: str) -> None:
    """On a dark screen, the button changes the colours without anywhere to keep the choice; paper is white, unfolded and without buttons, whatever the screen is."""
    background = "getComputedStyle(document.documentElement).backgroundColor"
    before = page.evaluate(background)
    page.get_by_role("button", name="light / dark").click()
    after = page.evaluate(background)
    assert before != after, before
    page.get_by_role("button", name="light / dark").click()
    page.evaluate(ON_PAPER)
    pdf = page.pdf(format="A4", print_background=True)
    assert len(pdf) > 10_000, len(pdf)
    paper = page.evaluate("window.paper")
    assert paper and paper["scheme"] == "light" and paper["text"] < 90 and paper["folded"] == 0, (name, paper)
    if name in ("diagnosis", "comparison"):
        assert paper["wholes"] > 0, "something was folded"
    assert page.evaluate(background) == before, "the screen is as before"
    folded = page.locator("details.whole:not([open])").count()
    page.emulate_media(media="print", color_scheme="dark")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    surfaces = page.evaluate(SURFACES)
    assert surfaces["darkest"] > 200 and surfaces["screen"] == 0, (name, surfaces)
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("details.whole:not([open])").count() == folded, "what was folded is folded again"


def without_scripts(browser: Browser, name: str, expected: dict) -> None:
    context = browser.new_context(java_script_enabled=False, offline=True)
    page = context.new_page()
    page.goto((FOLDER / name / "report.html").as_uri())
    text = page.locator("body").inner_text()
    assert expected["summary"] in text, f"{name} without scripts: {text[:2000]}"
    context.close()


def not_considered(browser: Browser) -> None:
    """What could not be considered, and the column or setting that would make it testable."""
    page, _ = opened(browser, "diagnosis", 1600, "light")
    page.locator("summary", has_text="could not be considered").click()
    rows = page.get_by_role("region", name="What could not be considered").locator("tbody tr")
    assert rows.count() >= 1 and all(len(row.split("\t")) == 3 and row.split("\t")[2].strip() for row in rows.all_inner_texts())
    page.context.close()


def main() -> None:
    if PICTURES:
        PICTURES.mkdir(exist_ok=True)
    names = sorted(path.parent.name for path in FOLDER.glob("*/report.html"))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for name in names:
            expected = json.loads((FOLDER / f"{name}.json").read_text())
            looks(browser, name, expected)
            without_scripts(browser, name, expected)
            print(f"{name}: {(FOLDER / name / 'report.html').stat().st_size / 1000:.0f} kB")
        if "diagnosis" in names:
            not_considered(browser)
        browser.close()


main()
