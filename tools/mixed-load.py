"""Does a server stay as it is? Many kinds of work for an hour, and what its processes hold meanwhile.

    cargo build --release --locked -p rotortwin-network
    cargo test --release --locked -p rotortwin-tests --test python_client       # makes the environment with the client
    target/python-client/bin/python tools/mixed-load.py [MINUTES [SEED]]        # 60, 1
    target/python-client/bin/python tools/mixed-load.py --each COUNT [SEED [NAME…]]   # one kind of action after the other, COUNT times

Eleven clients at once: flights that are flown and read, flights in real time that are canceled, campaigns and SQL over them, logs with a hidden
effect that are compared and diagnosed, FDI sessions that are fed, lists and the page, all events, requests that make no sense, uploads that
break off, half requests that are left lying, downloads that nobody reads. Each deletes what it has made, but for the last few, as somebody with little disk would.

Every ten seconds: resident memory, open descriptors and threads of the server and of its workers (processes that live as long as the server does;
children of a job come and go), and the bytes of the data folder. From the second quarter of the time on (caches are full then) the slope of each is
fitted over twelve averages of equal time, with a 95 % interval (Student's t, ten degrees of freedom). Exit status 1: an answer 5xx, a job that ended otherwise
than it should, or a slope whose whole interval is above what an hour may add (MOST_AN_HOUR).

`--each` tells which kind of action takes memory: a fresh server for each kind, four clients without pauses, and the slope of its resident memory
over the second three quarters of the actions, in MB per 1,000 of them. ROTORTWIN_SERVER_ENV="NAME=VALUE …" goes to the server alone (MALLOC_ARENA_MAX=1,
LD_PRELOAD=…), to tell a leak from an allocator that keeps what was freed.
"""

import http.client
import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from served import ROOT, serve

sys.path.insert(0, str(ROOT / "clients/python/src"))
from rotortwin import Client, NotFound  # noqa: E402

#: An hour may add so much, before the script says that something grows.
MOST_AN_HOUR = {"memory, MB": 8.0, "descriptors": 4.0, "threads": 4.0}
SAMPLE_S = 10.0
#: Student's t, 97.5 %, ten degrees of freedom: twelve averages less two.
AVERAGES, T_975 = 12, 2.228
CAMPAIGN = """
name = "load"
description = "flights of a mixed load"
scenario = "../scenarios/short-hover.toml"
seed = {seed}
flights = 16
[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]
"""


class Load:
    """The clients: each an action that is repeated until the time is over."""

    def __init__(self, url: str, seed: int, folder: Path) -> None:
        self.url, self.seed, self.folder = url, seed, folder
        self.host, self.port = re.match(r"http://([\d.]+):(\d+)", url).groups()
        self.over = threading.Event()
        #: Factor on all times that a client waits.
        self.slowness = 1.0
        self.done: Counter[str] = Counter()
        self.wrong: list[str] = []

    def actions(self) -> list[tuple[Callable[[Client, random.Random], None], float]]:
        """What is done, and the pause after it, s."""
        return [
            (self.fly, 1.0), (self.cancel, 4.0), (self.campaign, 30.0), (self.find, 40.0), (self.monitor, 5.0), (self.look, 0.5),
            (self.follow, 1.0), (self.nonsense, 0.5), (self.break_off, 3.0), (self.leave_half, 2.0), (self.read_nothing, 5.0),
        ]

    def start(self) -> list[threading.Thread]:
        threads = [threading.Thread(target=self.repeat, args=(one, pause, place)) for place, (one, pause) in enumerate(self.actions())]
        for thread in threads:
            thread.start()
        return threads

    def repeat(self, action: Callable[[Client, random.Random], None], pause_s: float, place: int) -> None:
        chance = random.Random(f"{self.seed} {place}")
        with Client(self.url) as client:
            while not self.over.is_set():
                try:
                    action(client, chance)
                    self.done[action.__name__] += 1
                except Exception as error:
                    if not self.over.is_set():
                        where = traceback.extract_tb(error.__traceback__)
                        line = next(one.lineno for one in where if one.filename == __file__ and one.name == action.__name__)
                        self.wrong.append(f"{action.__name__} (line {line}): {type(error).__name__}: {error}")
                        if len(self.wrong) <= 20:
                            print(f"wrong: {self.wrong[-1]}", flush=True)
                self.over.wait(chance.uniform(0.5, 1.5) * pause_s)

    def fly(self, client: Client, chance: random.Random) -> None:
        run = client.runs.submit("short-hover", seed=chance.randrange(1 << 62), link=chance.choice(["in-process", "iceoryx2"]))
        run = client.runs.wait(run.id, check=True)
        client.runs.samples(run.id, ["roll_rad", "duty_*"], points=400)
        client.runs.artifact(run.id, "report.html")
        old = client.runs.list(status="done", limit=100)
        for one in list(old)[40:]:
            # Another client may be faster.
            with suppress(NotFound):
                client.runs.delete(one.id)

    def cancel(self, client: Client, chance: random.Random) -> None:
        run = client.runs.submit("short-hover", pace="real-time", seed=chance.randrange(1 << 62))
        time.sleep(chance.uniform(0.0, 3.0) * self.slowness)
        client.runs.cancel(run.id)
        run = client.runs.wait(run.id)
        assert run.status in ("canceled", "done"), run.status
        client.runs.delete(run.id)

    def campaign(self, client: Client, chance: random.Random) -> None:
        job = client.campaigns.submit(text=CAMPAIGN.format(seed=chance.randrange(1 << 31)))
        client.campaigns.wait(job.id, check=True)
        answer = client.query("SELECT count(*) AS n FROM campaign", campaigns=[job.id])
        assert answer.rows == [[16]], answer
        client.campaigns.delete(job.id)

    def find(self, client: Client, chance: random.Random) -> None:
        log = self.ask("POST", "/api/v1/logs/generate", {"effect": "rotor-drag", "seed": chance.randrange(1 << 31), "duration_s": 20})
        log = client.logs.wait(log["id"], check=True)
        for kind in (client.comparisons, client.diagnoses):
            job = kind.submit(vehicle="f550", logs=[log.id])
            kind.wait(job.id, check=True)
            kind.report(job.id)
            kind.delete(job.id)
        client.logs.delete(log.id)

    def monitor(self, client: Client, chance: random.Random) -> None:
        sample = {"velocity_ned_m_s": [0, 0, 0], "attitude_rad": [0, 0, 0], "body_rates_rad_s": [0, 0, 0], "duty": [0.5] * 6, "battery_voltage_v": 15.5}
        with client.fdi.open("f550") as session:
            for _ in range(10):
                session.feed([sample] * 400)
            session.state()

    def look(self, client: Client, chance: random.Random) -> None:
        path = chance.choice(["runs?limit=50", "campaigns", "logs", "catalogue", "limits", "vehicles", "table?columns=steps", "models"])
        self.ask("GET", f"/api/v1/{path}")
        self.bytes("GET", chance.choice(["/", "/healthz", "/readyz", "/metrics", "/api/v1/openapi.json"]))

    def follow(self, client: Client, chance: random.Random) -> None:
        with socket.create_connection((self.host, int(self.port)), timeout=5) as stream:
            stream.sendall(f"GET /api/v1/events HTTP/1.1\r\nhost: {self.host}\r\n\r\n".encode())
            end = time.monotonic() + chance.uniform(1, 20) * self.slowness
            while time.monotonic() < end and not self.over.is_set():
                stream.settimeout(max(0.01, min(1.0, end - time.monotonic())))
                try:
                    if not stream.recv(65536):
                        raise RuntimeError("the stream of events ended by itself")
                except TimeoutError:
                    continue

    def nonsense(self, client: Client, chance: random.Random) -> None:
        method, path, body, expected = chance.choice([
            ("POST", "/api/v1/runs", {"scenario": "no-such"}, (404, 422)),
            ("POST", "/api/v1/runs", {"scenario": 5}, (422,)),
            ("POST", "/api/v1/campaigns", {"text": "name = "}, (422,)),
            ("GET", "/api/v1/runs/no-such", None, (404,)),
            ("GET", "/api/v1/telemetry?runs=", None, (400,)),
            ("POST", "/api/v1/queries", {"sql": "SELECT", "runs": ["x"]}, (404, 422)),
            ("DELETE", "/api/v1/vehicles/f550", None, (404,)),
            ("PATCH", "/api/v1/runs", None, (405,)),
        ])
        status = self.bytes(method, path, body, any_status=True)[0]
        assert status in expected, f"{method} {path}: {status}"

    def break_off(self, client: Client, chance: random.Random) -> None:
        with socket.create_connection((self.host, int(self.port)), timeout=5) as stream:
            head = f"POST /api/v1/logs?name=half.csv HTTP/1.1\r\nhost: {self.host}\r\ncontent-type: application/octet-stream\r\ncontent-length: 5000000\r\n\r\n"
            stream.sendall(head.encode() + b"t,roll\n" * chance.randrange(1, 100_000))

    def leave_half(self, client: Client, chance: random.Random) -> None:
        with socket.create_connection((self.host, int(self.port)), timeout=5) as stream:
            stream.sendall(b"GET /api/v1/runs HTTP/1.1\r\nhos")
            self.over.wait(chance.uniform(1, 15) * self.slowness)

    def read_nothing(self, client: Client, chance: random.Random) -> None:
        runs = list(client.runs.list(status="done", limit=1))
        if not runs:
            return
        with socket.create_connection((self.host, int(self.port)), timeout=5) as stream:
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            stream.sendall(f"GET /api/v1/runs/{runs[0].id}/artifacts/run.mcap HTTP/1.1\r\nhost: {self.host}\r\n\r\n".encode())
            self.over.wait(chance.uniform(1, 10) * self.slowness)

    def ask(self, method: str, path: str, body: object = None) -> dict:
        return json.loads(self.bytes(method, path, body)[1])

    def bytes(self, method: str, path: str, body: object = None, any_status: bool = False) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection(self.host, int(self.port), timeout=60)
        try:
            text = None if body is None else json.dumps(body)
            connection.request(method, path, text, {"content-type": "application/json"} if text else {})
            answer = connection.getresponse()
            got = answer.status, answer.read()
        finally:
            connection.close()
        if got[0] >= 500 or (got[0] >= 400 and not any_status):
            raise RuntimeError(f"{method} {path}: {got[0]} {got[1][:300]!r}")
        return got


def children(pid: int) -> list[int]:
    """Of the server, those that live as long as it does."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            found += map(int, (task / "children").read_text().split())
        except OSError:
            continue
    return found


def held(pid: int) -> dict[str, float]:
    """What a process holds now."""
    status = Path(f"/proc/{pid}/status").read_text()
    value = lambda key: float(re.search(rf"^{key}:\s+(\d+)", status, re.MULTILINE)[1])  # noqa: E731
    return {"memory, MB": value("VmRSS") / 1024, "descriptors": float(len(os.listdir(f"/proc/{pid}/fd"))), "threads": value("Threads")}


def heap(url: str) -> dict[str, float]:
    """What the server's allocator has: in use, and freed but kept; empty: it does not say."""
    try:
        with urllib.request.urlopen(f"{url}/metrics", timeout=60) as answer:
            found = re.findall(r'^rotortwin_heap_bytes\{state="(\w+)"\} (\d+)', answer.read().decode(), re.MULTILINE)
    except OSError:
        return {}
    return {f"heap {state}, MB": int(size) / (1 << 20) for state, size in found}


def folder_mb(folder: Path) -> float:
    total = 0
    for place, _, files in os.walk(folder):
        for name in files:
            try:
                total += os.lstat(os.path.join(place, name)).st_blocks * 512
            except OSError:
                continue
    return total / 1e6


def slope(times_h: list[float], values: list[float]) -> tuple[float, float]:
    """Growth per hour (or whatever goes along) over averages of equal time, and half of its 95 % interval."""
    size = len(values) // AVERAGES
    mean = lambda all, k: sum(all[k * size : (k + 1) * size]) / size  # noqa: E731
    x = [mean(times_h, k) for k in range(AVERAGES)]
    y = [mean(values, k) for k in range(AVERAGES)]
    x0, y0 = sum(x) / AVERAGES, sum(y) / AVERAGES
    xx = sum((a - x0) ** 2 for a in x)
    b = sum((a - x0) * (c - y0) for a, c in zip(x, y, strict=True)) / xx
    rest = sum((c - y0 - b * (a - x0)) ** 2 for a, c in zip(x, y, strict=True))
    return b, T_975 * (rest / (AVERAGES - 2) / xx) ** 0.5


@contextmanager
def serving(seed: int) -> Iterator[tuple[subprocess.Popen, Load, Path]]:
    """A server with an empty data folder, and clients for it."""
    with tempfile.TemporaryDirectory(prefix="rotortwin-mixed-load-") as scratch:
        data = Path(scratch) / "data"
        server, url = serve(data, ["--rate", "1000000"])
        try:
            time.sleep(1.0)
            yield server, Load(url, seed, Path(scratch)), data
        finally:
            server.send_signal(signal.SIGTERM)
            server.wait(timeout=60)


def main() -> int:
    if sys.argv[1:2] == ["--each"]:
        names = sys.argv[4:] or [action.__name__ for action, _ in Load("http://127.0.0.1:0", 0, Path()).actions()]
        seed = int(sys.argv[3]) if len(sys.argv) > 3 else 1
        print(f"{'':27}{'actions':>8} {'at first':>9} {'at the end':>11}   MB per 1,000 actions")
        return max(each(name, int(sys.argv[2]), seed) for name in names)
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    with serving(seed) as (server, load, data):
        return watch(server, load, data, minutes)


def each(name: str, count: int, seed: int) -> int:
    """One kind of action, so many times: what it adds to the memory of the server."""
    with serving(seed) as (server, load, _):
        load.slowness = 0.01
        action = next(one for one, _ in load.actions() if one.__name__ == name)
        if name == "read_nothing":
            with Client(load.url) as client:
                load.fly(client, random.Random(seed))
        threads = [threading.Thread(target=load.repeat, args=(action, 0.0, place)) for place in range(4)]
        for thread in threads:
            thread.start()
        dones: list[float] = []
        series: dict[str, list[float]] = {}
        pause_s = 0.1
        while (now := load.done[name]) < count and len(load.wrong) <= count:
            dones.append(now / 1000)
            for quantity, value in ({"memory, MB": held(server.pid)["memory, MB"]} | heap(load.url)).items():
                series.setdefault(quantity, []).append(value)
            time.sleep(pause_s)
            # Some hundred samples, however long it takes.
            pause_s *= 1.003
        load.over.set()
        for thread in threads:
            thread.join(timeout=60)
        first = next(place for place, done in enumerate(dones) if 4000 * done >= count)
        for quantity, values in series.items():
            growth, half = slope(dones[first:], values[first:])
            print(f"{name:13}{quantity:14}{count:8} {values[first]:9.1f} {values[-1]:11.1f}   {growth:+.3f} [{growth - half:+.3f}, {growth + half:+.3f}]"
                  + (f"   {len(load.wrong)} wrong" if load.wrong else ""), flush=True)
        return 1 if load.wrong else 0


def watch(server: subprocess.Popen, load: Load, data: Path, minutes: float) -> int:
    lasting = {server.pid: "server"} | {pid: f"worker {k}" for k, pid in enumerate(children(server.pid), 1)}
    threads = load.start()
    begun, times = time.monotonic(), []
    series: dict[tuple[str, str], list[float]] = {}
    while (now := time.monotonic() - begun) < minutes * 60:
        times.append(now / 3600)
        for pid, name in lasting.items():
            try:
                for quantity, value in (held(pid) | (heap(load.url) if name == "server" else {})).items():
                    series.setdefault((name, quantity), []).append(value)
            except OSError:
                sys.exit(f"{name} (process {pid}) has gone after {now:.0f} s")
        series.setdefault(("data folder", "size, MB"), []).append(folder_mb(data))
        if len(times) % 30 == 1:
            print(f"{now / 60:5.1f} min  " + "  ".join(f"{name} {held(pid)['memory, MB']:.0f} MB" for pid, name in lasting.items())
                  + f"  {sum(load.done.values())} done, {len(load.wrong)} wrong", flush=True)
        time.sleep(SAMPLE_S)
    load.over.set()
    for thread in threads:
        thread.join(timeout=60)
    print(f"\n{minutes:g} minutes, seed {load.seed}: " + ", ".join(f"{name} {count}" for name, count in sorted(load.done.items()))
          + f"; {len(load.wrong)} wrong")
    grows = False
    first = len(times) // 4
    if len(times) - first < 2 * AVERAGES:
        print("too short to say how anything grows")
        return 1 if load.wrong else 0
    print(f"\n{'':12} {'':12} {'after a quarter':>16} {'at the end':>11} {'most':>8}   growth per hour")
    for (name, quantity), values in series.items():
        growth, half = slope(times[first:], values[first:])
        grows |= growth - half > MOST_AN_HOUR.get(quantity, float("inf"))
        print(f"{name:12} {quantity:12} {values[first]:16.1f} {values[-1]:11.1f} {max(values):8.1f}   {growth:+.2f} [{growth - half:+.2f}, {growth + half:+.2f}]")
    return 1 if load.wrong or grows else 0


if __name__ == "__main__":
    sys.exit(main())
