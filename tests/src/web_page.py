"""The web page in a real browser: Chromium, driven by Playwright, against a real server.

web_page.py SERVER CHROMIUM FOLDER SCENARIO; FOLDER has the logs, and takes the pictures of docs/web.md, and one of what failed. Each scenario fails on an error on the
console, an exception, or a request to another host.
"""

import json
import math
import re
import sys
import time
import urllib.parse
import urllib.request
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright

SERVER, CHROMIUM, FOLDER, SCENARIO = sys.argv[1], sys.argv[2], Path(sys.argv[3]), sys.argv[4]
PAGES = ["/twin", "/runs?new=1", "/campaigns", "/blind", "/fdi", "/library", "/library?kind=vehicles&name=quad-x"]
# A job on a machine that compiles meanwhile.
PATIENCE_MS = 60_000
FIRST_LOAD_KB = 150
# In the live flight.
FAULT = "fault=[{time_s=6.0, rotor=3, blade='c'}]"
# Software GL: no machine of ours has a picture card.
OPTIONS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def api(path: str, body: dict | None = None) -> dict:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(f"{SERVER}/api/v1{path}", data, {"content-type": "application/json"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.load(answer)


def is_described(url: str) -> bool:
    """Whether the server's own description has this address, and the parameters that the page sends."""
    parts = urllib.parse.urlsplit(url)
    for template, operations in DESCRIBED.items():
        if re.fullmatch(re.sub(r"\\{\w+\\}", "[^/]+", re.escape(template)), parts.path):
            known = {one["name"] for one in operations.get("get", {}).get("parameters", [])}
            return "get" in operations and set(urllib.parse.parse_qs(parts.query)) <= known
    return False


class Watch:
    """What must not happen on a page.

    The page asks for what newer servers have, and says so where this one has not: such an error of the browser is printed and no complaint.
    """

    def __init__(self, page: Page) -> None:
        self.complaints: list[str] = []
        page.on("console", lambda m: self.error(m.text, m.location.get("url", "")) if m.type == "error" else None)
        page.on("pageerror", lambda error: self.complaints.append(f"exception: {error}"))
        page.on("request", lambda r: self.complaints.append(f"foreign host: {r.url}") if not r.url.startswith((SERVER, SERVER.replace("http", "ws"), "blob:", "data:")) else None)

    def error(self, text: str, url: str) -> None:
        socket = re.search(r"'(ws:[^']+)' failed: Error during WebSocket handshake", text)
        asked = socket[1] if socket else url
        if ("/api/" in asked and ("404" in text or "405" in text or socket)) and not is_described(asked):
            print(f"this server does not have {asked}")
            return
        self.complaints.append(f"console: {text} {url}")

    def check(self) -> None:
        assert not self.complaints, "\n".join(self.complaints)


def open_page(browser: Browser, width: int = 1600, scheme: str = "light") -> tuple[Page, Watch]:
    page = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme).new_page()
    page.set_default_timeout(PATIENCE_MS)
    return page, Watch(page)


def drop(page: Page, name: str) -> None:
    page.goto(f"{SERVER}/twin")
    page.set_input_files("input[type=file]", FOLDER / name)


def force_ratios(page: Page) -> list[float]:
    """Force error of each version, in units of the noise."""
    figure = page.locator("figure", has=page.get_by_role("heading", name=re.compile("^force")))
    return [float(x) for x in re.findall(r"\(([\d.]+) × noise\)", figure.first.inner_text())]


def picture(page: Page, name: str) -> None:
    """For docs/web.md."""
    page.evaluate("scrollTo(0, 0)")
    page.wait_for_timeout(1500)
    page.screenshot(path=FOLDER / f"{name}.png", full_page=True)


def query(page: Page, name: str) -> str:
    return re.search(rf"[?&]{name}=([^&]+)", page.url)[1]


def loop(browser: Browser) -> None:
    """A log with a hidden rotor drag: the effect is named, added, the error falls to the noise; undo gives the old numbers."""
    page, watch = open_page(browser)
    drop(page, "drag.parquet")
    add = page.get_by_role("button", name=re.compile("^Add to the model"))
    add.wait_for()
    assert page.get_by_role("heading", name="Rotor drag").is_visible()
    diagnosis = api(f"/diagnoses/{query(page, 'diag')}")["result"]
    assert diagnosis["sentence"] in page.locator("#step-5").inner_text(), "the sentence is that of the diagnosis"
    (parameter,) = diagnosis["effects"][0]["parameters"]
    shown = re.search(r"([\d.]+) ± ([\d.]+) N·s/m", page.locator("#step-5 .facts").inner_text())
    assert abs(float(shown[1]) - parameter["value"]) < 0.51e-4 and abs(float(shown[2]) - parameter["interval_95"]) < 0.51e-4, shown[0]
    before = force_ratios(page)
    assert len(before) == 1 and before[0] > 5, before
    add.click()
    page.locator("#step-5").get_by_text("The model agrees with the flight.").wait_for()
    page.wait_for_function("document.querySelector('#step-6').innerText.includes('v1')")
    after = force_ratios(page)
    assert len(after) == 2 and after[0] == before[0] and after[1] <= 1.1, after
    page.reload()
    page.locator("#step-5").get_by_text("The model agrees with the flight.").wait_for()
    picture(page, "twin")
    page.get_by_role("button", name=re.compile("^Undo")).click()
    add.wait_for()
    page.wait_for_function("!document.querySelector('#step-6').innerText.includes('@v1')")
    assert force_ratios(page) == before
    watch.check()


def healthy(browser: Browser) -> None:
    """Nothing is hidden: "agrees". A file that is no log: one sentence."""
    page, watch = open_page(browser)
    drop(page, "healthy.parquet")
    page.locator("#step-5").get_by_text("The model agrees with the flight.").wait_for()
    assert page.get_by_role("button", name=re.compile("^Add to the model")).count() == 0
    drop(page, "picture.csv")
    refusal = page.locator("#step-1 .say.bad")
    refusal.wait_for()
    assert "log.csv" in refusal.inner_text(), refusal.inner_text()
    watch.check()


def vehicle(browser: Browser) -> None:
    """A vehicle from the log, mass and size: refused where it is typed, identified, drawn, kept; the loop goes on with it."""
    page, watch = open_page(browser)
    drop(page, "healthy.parquet")
    page.get_by_role("button", name="A new one from this log").click()
    step = page.locator("#step-3")
    button = step.get_by_role("button", name="Identify the vehicle")
    step.get_by_label("Mass with battery").fill("heavy")
    button.click()
    refusal = step.get_by_text("'heavy' is no number above 0")
    refusal.wait_for()
    step.get_by_label("Mass with battery").fill("2.1")
    step.get_by_label("Size is given as").select_option(label="Frame size, mm (motor to opposite motor)")
    step.get_by_label("Frame size, mm", exact=True).fill("550")
    step.get_by_label("Name").fill("mine from here")
    button.click()
    step.get_by_text("is no name for a document").wait_for()
    step.get_by_label("Name").fill("")
    page.reload()
    page.get_by_role("button", name="A new one from this log").click()
    assert step.get_by_label("Mass with battery").input_value() == "2.1", "what was typed outlives a reload"
    step.get_by_label("Name").fill("mine")
    button.click()
    card = step.get_by_role("group", name="The identified vehicle")
    card.wait_for()
    found = api(f"/identifications/{query(page, 'ident')}")["result"]["identified"]
    rows = card.get_by_role("region", name="Identified values").locator("tbody tr")
    assert rows.count() == len(found["values"]) > 10
    for row, value in zip(rows.all(), found["values"], strict=True):
        text = row.inner_text().replace("−", "-")
        shown = float(re.search(r"-?[\d.]+(·10)?", row.locator("td").first.inner_text().replace("−", "-"))[0].replace("·10", ""))
        assert value["name"] in text and value["how"] in text, (value, text)
        size = abs(value["value"]) or 1.0
        scaled = shown if 1e-4 <= size < 1e6 or value["value"] == 0 else shown * 10 ** math.floor(math.log10(size))
        assert abs(scaled - value["value"]) <= 1e-3 * size, (value, text)
    assert card.get_by_role("img", name=re.compile("rotor 6 turns")).is_visible()
    card.get_by_role("button", name=re.compile("^Keep it as mine")).click()
    card.get_by_text("kept as mine").wait_for()
    page.locator("#step-5 .say.sentence").wait_for()
    assert "mine-" in page.locator("#step-3 .note").inner_text() and query(page, "vehicle") == "mine"
    assert "mine" in api("/vehicles")["own"]
    # A frame that the log cannot be of: the server's sentence, where it was asked.
    step.locator("summary", has_text="Where the log does not say it").click()
    step.get_by_label("Frame (motor numbers as in ArduPilot)").fill("quad-x")
    step.get_by_role("button", name="Identify again").click()
    step.locator(".say.bad", has_text="4 rotors").wait_for()
    picture(page, "vehicle")
    assert step.get_by_label("Mass with battery").input_value() == "2.1"
    watch.check()


def untold(browser: Browser) -> None:
    """A flight that cannot tell two effects apart: the manoeuvre that does is found, flown in the simulator, and copied."""
    page, watch = open_page(browser)
    drop(page, "untold.parquet")
    step = page.locator("#step-5")
    step.get_by_role("button", name="Find the manoeuvre that tells").click()
    step.get_by_role("region", name="Manoeuvres, best first").wait_for()
    best = api(f"/next-flights/{query(page, 'next')}")["result"][0]
    said = step.locator("p[role=status]").inner_text()
    assert best["manoeuvre"] in said, said
    assert "The real vehicle has to fly it" in step.inner_text()
    with page.expect_download() as download:
        step.get_by_role("button", name="Take the scenario as a file").click()
    text = Path(download.value.path()).read_text()
    assert f'name = "{best["manoeuvre"]}"' in text and 'vehicle = "../vehicles/f550.toml"' in text, text
    step.get_by_label("Copy it into the library as").fill("tells-apart")
    step.get_by_role("button", name="Copy", exact=True).click()
    step.get_by_text("It is in the library as the scenario tells-apart.").wait_for()
    assert "tells-apart" in api("/scenarios")["own"]
    step.get_by_role("button", name="Fly it in the simulator").click()
    step.get_by_text("done", exact=True).wait_for()
    page.reload()
    step.get_by_text("done", exact=True).wait_for()
    step.get_by_role("link", name=re.compile("^Watch")).click()
    page.get_by_role("heading", name="Summary").wait_for()
    watch.check()


def live(browser: Browser) -> None:
    """A flight at real time is shown while it flies, and a reload loses nothing; afterwards it is done."""
    page, watch = open_page(browser)
    run = api("/runs", {"scenario": "short-hover", "link": "in-process", "pace": "real-time", "set": ["duration_s=10.0", "fdi.calibration_start_s=1.0", "fdi.calibration_end_s=5.0", FAULT]})["id"]
    page.goto(f"{SERVER}/runs/{run}")
    lanes = page.get_by_label("Verdicts over the true faults").first
    lanes.wait_for()
    page.locator(".tag", has_text="running").first.wait_for()
    page.reload()
    lanes.wait_for()
    page.locator("h1 + .tag", has_text="done").wait_for()
    page.get_by_role("heading", name="Summary").wait_for()
    page.locator("figure canvas").nth(5).wait_for()
    picture(page, "run")
    watch.check()


def pages(browser: Browser) -> None:
    """Each page, narrow and wide, dark and light: nothing sticks out, axe finds nothing serious; the first load is small."""
    found = []
    for width, scheme in [(1600, "light"), (390, "dark")]:
        page, watch = open_page(browser, width, scheme)
        for path in PAGES:
            page.goto(f"{SERVER}{path}", wait_until="load")
            page.locator("h1").wait_for()
            page.wait_for_timeout(700)
            out = page.evaluate("document.documentElement.scrollWidth - innerWidth")
            if out > 0:
                found.append(f"{path} at {width}: {out} px stick out")
            for violation in Axe().run(page).response["violations"]:
                if violation["impact"] in ("serious", "critical"):
                    found.append(f"{path} at {width}: {violation['id']}: {[node['target'] for node in violation['nodes'][:3]]}")
            if path == "/twin":
                sizes = page.evaluate("performance.getEntriesByType('resource').filter(r => r.name.includes('/assets/')).map(r => r.encodedBodySize)")
                if sum(sizes) > 1000 * FIRST_LOAD_KB or not sizes:
                    found.append(f"first load: {sum(sizes)} bytes")
        watch.check()
        # By keyboard alone: the first stop leads to the content.
        page.goto(f"{SERVER}/runs")
        page.locator("h1").wait_for()
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    assert not found, "\n".join(found)


DESCRIBED = api("/openapi.json")["paths"]
SCENARIOS = {f.__name__: f for f in (loop, healthy, vehicle, untold, live, pages)}

with sync_playwright() as playwright:
    chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
    began = time.monotonic()
    try:
        SCENARIOS[SCENARIO](chromium)
    except BaseException:
        for number, context in enumerate(chromium.contexts):
            for page in context.pages:
                page.screenshot(path=FOLDER / f"{SCENARIO}-{number}.png", full_page=True)
                print(page.url, page.locator("main").inner_text()[:3000])
        raise
    print(f"{SCENARIO}: {time.monotonic() - began:.1f} s")
    chromium.close()
