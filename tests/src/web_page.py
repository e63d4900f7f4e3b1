"""The web page in a real browser: Chromium, driven by Playwright, against a real server.

web_page.py SERVER CHROMIUM FOLDER SCENARIO; FOLDER has the logs and the server's folder `data`, and takes the pictures of docs/web.md, and one of what failed; ROTORTWIN names the program. Each scenario fails on an error on the
console, an exception, or a request to another host.
"""

import json
import math
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, Response, sync_playwright

SERVER, CHROMIUM, FOLDER, SCENARIO = sys.argv[1], sys.argv[2], Path(sys.argv[3]), sys.argv[4]
PAGES = ["/twin", "/runs?new=1", "/campaigns", "/blind", "/fdi", "/library", "/library?kind=vehicles&name=quad-x"]
# A job on a machine that compiles meanwhile.
PATIENCE_MS = 120_000
FIRST_LOAD_KB = 150
# Table of 10,000 runs, s: twice what is wanted, as other things run beside the test; the time is printed.
MANY_S = 3.0
# In the live flight.
FAULT = "fault=[{time_s=6.0, rotor=3, blade='c'}]"
# No machine of ours has a graphics card. Chromium then puts pages together with the processor, as on any such machine, and draws WebGL with a
# processor, too (SwiftShader), if it is allowed to. `--use-angle=swiftshader` would make it take SwiftShader for a graphics card, and draw
# every text and line through that: 280 ms a picture instead of 11.
OPTIONS = ["--no-sandbox", "--enable-unsafe-swiftshader"]


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

    # What a scenario provokes.
    expected: str | None = None

    def error(self, text: str, url: str) -> None:
        if self.expected and re.search(self.expected, text):
            return
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


def until(page: Page, expression: str) -> None:
    """Waits until an expression of the page is true. (`wait_for_function` asks again by `eval`, which the page's policy forbids.)"""
    end = time.monotonic() + PATIENCE_MS / 1000
    while not page.evaluate(expression):
        assert time.monotonic() < end, f"never true: {expression}"
        time.sleep(0.02)


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
    page.locator("#step-5 summary", has_text="could not be considered").click()
    unconsidered = page.get_by_role("region", name="What could not be considered").locator("tbody tr").all_inner_texts()
    assert diagnosis["not_considered"] and unconsidered, "a flight without a height above ground, if nothing else"
    for one in diagnosis["not_considered"]:
        testable_by = ", ".join(one["columns"]) or one["setting"] or "–"
        assert any(all(words in row for words in (one["label"], one["reason"], testable_by)) for row in unconsidered), one
    (parameter,) = diagnosis["effects"][0]["parameters"]
    shown = re.search(r"([\d.]+) ± ([\d.]+) N·s/m", page.locator("#step-5 .facts").inner_text())
    assert abs(float(shown[1]) - parameter["value"]) < 0.51e-4 and abs(float(shown[2]) - parameter["interval_95"]) < 0.51e-4, shown[0]
    before = force_ratios(page)
    assert len(before) == 1 and before[0] > 5, before
    add.click()
    page.locator("#step-5").get_by_text("The model agrees with the flight.").wait_for()
    until(page, "document.querySelector('#step-6').innerText.includes('v1')")
    after = force_ratios(page)
    assert len(after) == 2 and after[0] == before[0] and after[1] <= 1.1, after
    page.reload()
    page.locator("#step-5").get_by_text("The model agrees with the flight.").wait_for()
    picture(page, "twin")
    page.get_by_role("button", name=re.compile("^Undo")).click()
    add.wait_for()
    until(page, "!document.querySelector('#step-6').innerText.includes('@v1')")
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
    assert "picture.csv" in refusal.inner_text(), refusal.inner_text()
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
    page.locator("#step-4 .heat").first.wait_for()
    # The bar of the page would lie over the picture.
    page.evaluate("document.querySelector('.bar').style.position = 'static'")
    card.screenshot(path=FOLDER / "vehicle.png")
    assert "mine-" in page.locator("#step-3 .note").inner_text() and query(page, "vehicle") == "mine"
    assert "mine" in api("/vehicles")["own"]
    # A frame that the log cannot be of: the server's sentence, where it was asked.
    step.locator("summary", has_text="Where the log does not say it").click()
    step.get_by_label("Frame (motor numbers as in ArduPilot)").fill("quad-x")
    step.get_by_role("button", name="Identify again").click()
    step.locator(".say.bad", has_text="4 rotors").wait_for()
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


def wait_for(path: str) -> dict:
    """A job that has ended."""
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while time.monotonic() < deadline:
        job = api(path)
        if job["status"] in ("done", "failed", "canceled"):
            return job
        time.sleep(0.1)
    raise AssertionError(f"{path} does not end")


def rows_of(name: str) -> list[list[str]]:
    """A log as rows of a canonical CSV, the names first."""
    request = urllib.request.Request(f"{SERVER}/api/v1/logs?name={name}", (FOLDER / name).read_bytes(), {"content-type": "application/octet-stream"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        log = json.load(answer)["id"]
    wait_for(f"/logs/{log}")
    with urllib.request.urlopen(f"{SERVER}/api/v1/logs/{log}/telemetry?channels=*&format=csv&points=100000", timeout=30) as answer:
        return [line.split(",") for line in answer.read().decode().splitlines()]


def write(name: str, rows: list[list[str]]) -> None:
    (FOLDER / name).write_text("\n".join(",".join(row) for row in rows) + "\n")


def repair(browser: Browser) -> None:
    """Exchanged axes and a wrong unit: the log is blamed, a click reads it again, the model agrees. What cannot be repaired says where it is wrong."""
    page, watch = open_page(browser)
    rows = rows_of("healthy.parquet")
    head = rows[0]
    exchanged = {"roll_rate_rad_s": "pitch_rate_rad_s", "pitch_rate_rad_s": "roll_rate_rad_s"}
    write("swapped.csv", [[exchanged.get(name, name) for name in head], *rows[1:]])
    accel = [head.index(f"accel_{axis}_m_s2") for axis in "xyz"]
    write("gravities.csv", [head, *([str(float(cell) / 9.80665) if k in accel and cell else cell for k, cell in enumerate(row)] for row in rows[1:])])
    agrees = page.locator("#step-5").get_by_text("The model agrees with the flight.")
    for name, blamed in [("swapped.csv", "#step-2 .say.bad"), ("gravities.csv", "#step-1 .say.bad")]:
        drop(page, name)
        page.locator(blamed).wait_for()
        words = page.locator(blamed).inner_text()
        assert ("Swapped axes" if name == "swapped.csv" else "accelerometer is in g") in words, words
        assert page.locator("#step-5 .say.sentence").count() == 0, "no model is compared with a log that is at fault"
        page.get_by_role("button", name="Read it again so").click()
        agrees.wait_for()
        assert page.locator("#step-2 .say.bad").count() == 0
    cell = head.index("yaw_rate_rad_s")
    rows[1000][cell] = "NaN"
    write("nan.csv", rows)
    drop(page, "nan.csv")
    page.locator("#step-1 .say.bad", has_text="row 1000, column yaw_rate_rad_s: 'NaN'").wait_for()
    watch.check()


def steps(browser: Browser) -> None:
    """Two hidden effects: two steps down, then the model agrees."""
    page, watch = open_page(browser)
    drop(page, "two.parquet")
    answer = page.locator("#step-5 .say.sentence")
    add = page.get_by_role("button", name=re.compile("^Add to the model"))
    for version in (1, 2):
        add.first.wait_for()
        add.first.click()
        until(page, f"document.querySelector('#step-6').innerText.includes('@v{version}')")
        until(page, "document.querySelector('#step-5 .say.sentence') && document.querySelector('#step-6 .bars')")
        if "The model agrees" in answer.inner_text():
            break
    answer.get_by_text("The model agrees with the flight.").wait_for()
    errors = api(f"/comparisons/{query(page, 'cmp')}")["result"]["logs"][0]["models"]
    assert len(errors) == 3, [model["model"] for model in errors]

    def ratio(model: dict) -> float:
        return sum(one["error"] / one["noise"] for one in model["errors"] if one["quantity"] in ("force", "torque", "voltage"))

    first, second, third = map(ratio, errors)
    assert first > second > third and third <= 3 * 1.1, (first, second, third)
    assert len(force_ratios(page)) == 3
    watch.check()


def stopped(word: str) -> int:
    """Waits for the process of a job of ours that has this word in its command, and stops it: so it is not done before its Cancel is clicked.

    The descriptor of the process: its number may be another's once it has ended.
    """
    end = time.monotonic() + PATIENCE_MS / 1000
    while time.monotonic() < end:
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                process = os.pidfd_open(int(entry.name))
            except ProcessLookupError:
                continue
            try:
                words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
                if word in words[1:4] and (entry / "cwd").resolve().is_relative_to(FOLDER.resolve()):
                    signal.pidfd_send_signal(process, signal.SIGSTOP)
                    return process
            except (FileNotFoundError, ProcessLookupError):
                pass
            os.close(process)
        time.sleep(0.005)
    raise AssertionError(f"no process of a job with {word!r}")


def goes_on(process: int) -> None:
    """Lets a process of [`stopped`] go on. Where we come late the server has killed it already: it gives a canceled job 0.9 s to end."""
    try:
        signal.pidfd_send_signal(process, signal.SIGCONT)
    except ProcessLookupError:
        print("killed before it could go on")
    os.close(process)


# By itself on an idle machine each ends within 2 s, and the times are printed; here a dozen other pages are loaded at the same time. What
# is not canceled never says so.
CANCELED_S = 10.0


def cancel(browser: Browser) -> None:
    """Whatever runs ends soon after a click on Cancel, says so, and can be asked for again."""
    page, watch = open_page(browser)

    def ends(step: int, what: str, word: str) -> None:
        process = stopped(word)
        row = page.locator(f"#step-{step} [role=status]", has_text=what)
        # Goes on once the server knows: what is as good as done would be done before.
        with page.expect_response(lambda answer: answer.url.endswith("/cancel")) as answer:
            row.get_by_role("button", name="Cancel").click()
        goes_on(process)
        page.locator(f"#step-{step}").get_by_text("It was canceled.").wait_for()
        told(what, answer.value)

    def told(what: str, answer: Response) -> None:
        """Since the page asked: how long the mouse waits for a browser that has no turn says nothing of us."""
        took = time.time() - answer.request.timing["startTime"] / 1000
        print(f"{what}: canceled after {took:.2f} s")
        assert took <= CANCELED_S, (what, took)

    # Through a line of 100 kB/s, as an upload is done at once otherwise.
    page.goto(f"{SERVER}/twin")
    network = page.context.new_cdp_session(page)
    network.send("Network.enable")
    limits = {"offline": False, "latency": 0, "downloadThroughput": -1}
    network.send("Network.emulateNetworkConditions", {**limits, "uploadThroughput": 100_000})
    page.set_input_files("input[type=file]", FOLDER / "drag.parquet")
    page.locator("#step-1 [role=status]", has_text="Sending drag.parquet").get_by_role("button", name="Cancel").click()
    page.get_by_text("The upload was canceled.").wait_for(timeout=2_000)
    network.send("Network.emulateNetworkConditions", {**limits, "uploadThroughput": -1})
    page.get_by_role("button", name=re.compile("^Fly it")).first.click()
    ends(1, "Importing the log", "example")
    drop(page, "untold.parquet")
    ends(5, "Looking for what is missing", "diagnose")
    page.locator("#step-5").get_by_role("button", name="Try again").click()
    page.locator("#step-5").get_by_role("button", name="Find the manoeuvre that tells").click()
    ends(5, "Flying eleven manoeuvres", "next-flight")
    drop(page, "drag.parquet")
    page.get_by_role("button", name="A new one from this log").click()
    page.get_by_label("Mass with battery").fill("2.1")
    page.get_by_label("Arm, m", exact=True).fill("0.275")
    page.get_by_role("button", name="Identify the vehicle").click()
    ends(3, "Identifying the vehicle", "from-log")
    page.goto(f"{SERVER}/runs/{api('/runs', {'scenario': 'reference-flight', 'pace': 'real-time'})['id']}")
    page.locator("h1 + .tag", has_text="running").wait_for()
    with page.expect_response(lambda answer: answer.url.endswith("/cancel")) as answer:
        page.get_by_role("button", name="Cancel").click()
    page.locator("h1 + .tag", has_text="canceled").wait_for()
    told("a live flight", answer.value)
    watch.check()


def strangers(browser: Browser) -> None:
    """Files that are no logs, and names that are HTML: one sentence each, and text stays text."""
    page, watch = open_page(browser)
    (FOLDER / "picture.png").write_bytes((FOLDER / "picture.csv").read_bytes())
    drop(page, "picture.png")
    page.locator("#step-1 .say.bad", has_text="picture.png").wait_for()
    run = api("/runs", {"scenario": "short-hover"})["id"]
    assert wait_for(f"/runs/{run}")["status"] == "done"
    with urllib.request.urlopen(f"{SERVER}/api/v1/runs/{run}/export?format=ulog", timeout=60) as answer:
        whole = answer.read()
    (FOLDER / "cut.ulg").write_bytes(whole[: len(whole) * 3 // 5 + 7])
    drop(page, "cut.ulg")
    page.locator("#step-2.done, #step-2.problem, #step-1 .say.bad").first.wait_for()
    (FOLDER / "stub.ulg").write_bytes(whole[:9])
    drop(page, "stub.ulg")
    page.locator("#step-1 .say.bad").wait_for()
    # No name of a document or file may be HTML; names of columns, cells and descriptions may.
    evil = "<script>document.title='taken'</script><img src=x onerror=document.title='taken'>"
    rows = rows_of("healthy.parquet")
    write("evil.csv", [[*rows[0], evil], *([*row, evil] for row in rows[1:])])
    drop(page, "evil.csv")
    page.locator("#step-2.done").wait_for()
    page.get_by_text("Delays, conversions, unused columns").click()
    page.locator("#step-2").get_by_text(evil).first.wait_for()
    with urllib.request.urlopen(f"{SERVER}/api/v1/scenarios/short-hover", timeout=30) as answer:
        scenario = re.sub(r"(?m)^description = .*$", f"description = {json.dumps(evil)}", answer.read().decode())
    put = urllib.request.Request(f"{SERVER}/api/v1/scenarios/evil", scenario.encode(), {"content-type": "application/toml"}, method="PUT")
    urllib.request.urlopen(put, timeout=30).close()
    page.goto(f"{SERVER}/library?kind=scenarios&name=evil")
    page.get_by_label("text of evil").wait_for()
    page.goto(f"{SERVER}/runs/{api('/runs', {'scenario': 'evil'})['id']}")
    page.get_by_role("heading", name="Summary").wait_for()
    page.get_by_text("The scenario as it was flown").click()
    page.get_by_text(evil).first.wait_for()
    page.goto(f"{SERVER}/runs?name={urllib.parse.quote(evil)}")
    page.get_by_text("No run of this kind").wait_for()
    assert page.title() != "taken" and page.locator("img[src=x]").count() == 0
    watch.check()


def session(browser: Browser) -> None:
    """A session that has ended: the token is asked for, what was typed stays, and the page goes on."""
    page, watch = open_page(browser)
    watch.expected = r"401 \(Unauthorized\)"
    data = FOLDER / "data"
    words = [os.environ["ROTORTWIN"], "token", "create", "reader", "--data", data]
    token = re.search(r"rtw_\w+", subprocess.run(words, check=True, capture_output=True, text=True).stdout)[0]
    page.goto(f"{SERVER}/runs?new=1")
    form = page.get_by_role("form", name="Sign in")
    field = form.get_by_label(re.compile("access token"))
    field.fill("rtw_wrong")
    form.get_by_role("button", name="Sign in").click()
    form.locator(".say.bad").wait_for()
    field.fill(token)
    form.get_by_role("button", name="Sign in").click()
    page.get_by_text("The scenario is valid.").wait_for()
    page.get_by_label("Seed").fill("77")
    page.context.clear_cookies()
    page.get_by_role("button", name="Fly", exact=True).click()
    field.wait_for()
    assert page.get_by_label("Seed").input_value() == "77"
    field.fill(token)
    form.get_by_role("button", name="Sign in").click()
    page.locator("h1 + .tag", has_text="done").wait_for()
    assert page.get_by_text("seed 77").is_visible(), "what was asked for before is done after"
    watch.check()


def many(browser: Browser) -> None:
    """10,000 runs: the table is there and filtered at once, and more rows come when asked for."""
    run = api("/runs", {"scenario": "short-hover"})["id"]
    assert wait_for(f"/runs/{run}")["status"] == "done"
    # Copies of one row, as 10,000 flights would take half an hour.
    with sqlite3.connect(FOLDER / "data" / "rotortwin.sqlite", timeout=30) as store:
        names = [row[1] for row in store.execute("PRAGMA table_info(job)")]
        row = dict(zip(names, store.execute("SELECT * FROM job WHERE id = ?", [run]).fetchone(), strict=True))
        copies = [{**row, "id": f"{int(run[:12], 16) - 1 - k:012x}{k:020x}", "idempotency_key": None, "name": "rare" if k == 9_000 else row["name"]} for k in range(9_999)]
        store.executemany(f"INSERT INTO job VALUES ({','.join(':' + name for name in names)})", copies)
    page, watch = open_page(browser)
    page.goto(f"{SERVER}/library")
    page.get_by_role("heading", name="Library").wait_for()
    began = time.monotonic()
    page.get_by_role("link", name="Runs").click()
    page.locator("tbody tr").nth(49).wait_for()
    usable = time.monotonic() - began
    began = time.monotonic()
    page.get_by_label("Scenario").last.fill("rare")
    page.keyboard.press("Enter")
    until(page, "document.querySelectorAll('tbody tr').length === 1")
    filtered = time.monotonic() - began
    page.get_by_label("Scenario").last.fill("")
    page.keyboard.press("Enter")
    page.locator("tbody tr").nth(49).wait_for()
    began = time.monotonic()
    page.get_by_role("button", name="500 more").click()
    page.locator("tbody tr").nth(549).wait_for()
    more = time.monotonic() - began
    print(f"10,000 runs: table {usable:.2f} s, one of them by name {filtered:.2f} s, 500 more {more:.2f} s")
    assert usable < MANY_S and filtered < MANY_S, (usable, filtered)
    watch.check()


def keyboard(browser: Browser) -> None:
    """The whole loop of the twin page without a mouse; the focus is seen wherever it stands."""
    page, watch = open_page(browser)
    page.goto(f"{SERVER}/twin")
    page.get_by_role("heading", name="Twin").wait_for()

    def tab_to(words: str, most: int = 250) -> None:
        for _ in range(most):
            page.keyboard.press("Tab")
            found = page.evaluate(
                "() => { const e = document.activeElement; const s = getComputedStyle(e); const name = e.getAttribute('aria-label') || e.textContent || '';"
                " return [name.trim(), e.closest('label') !== null || s.outlineStyle !== 'none' || s.boxShadow !== 'none', e.tagName]; }"
            )
            assert found[1] or found[2] == "BODY", f"the focus on {found} is not seen"
            if found[0].startswith(words):
                return
        raise AssertionError(f"no Tab leads to “{words}”")

    tab_to("Skip to the content")
    page.keyboard.press("Enter")
    tab_to("Fly it: A hidden effect")
    page.keyboard.press("Enter")
    add = page.get_by_role("button", name=re.compile("^Add to the model"))
    add.first.wait_for()
    tab_to("Add to the model")
    page.keyboard.press("Enter")
    until(page, "document.querySelector('#step-6').innerText.includes('@v1')")
    page.locator("#step-5 .say.sentence").wait_for()
    tab_to("Reveal what was hidden")
    page.keyboard.press("Enter")
    page.get_by_text("The truth:").wait_for()
    tab_to("Undo")
    page.keyboard.press("Enter")
    until(page, "!document.querySelector('#step-6').innerText.includes('@v1')")
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
SCENARIOS = {f.__name__: f for f in (loop, healthy, steps, vehicle, untold, repair, cancel, strangers, session, many, keyboard, live, pages)}

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
