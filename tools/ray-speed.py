"""How fast a Ray cluster flies a campaign for a server, against the server's own workers: the same campaign, the same two cores, in turns.

    cargo build --release --locked -p rotortwin-network
    cargo test --release --locked -p rotortwin-tests --test ray_executor        # makes the environment with Ray
    target/executors-environment/bin/python tools/ray-speed.py [FLIGHTS [SECONDS [TURNS]]]

Starts a cluster of this machine (a head that flies nothing, two nodes of one CPU), one server with `--workers 2`, one with the same and
`--executor ray=… --ray-parts 4`, and measures from the submission to the end of the campaign, turn by turn. Seeds are those of the campaign (5). The first
pair is not counted. Prints seconds, flights a second, and the ratio of the medians, with an interval of 95 % over the pairs' ratios (by Student's t, of their
logarithms).

On a machine that does other things as well, seconds of the wall say little. So processor time is counted, too, of everything that a way has on this machine (looked
up every 100 ms): of the server, of what flies, and of Ray itself (its head, raylets, agents, and the Python process of each submission), until no submission is left.
"""

import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from served import PROGRAM, ROOT, ask, serve, wait

DOCUMENT = """
name = "speed"
description = "how fast"
scenario = "../scenarios/short-hover.toml"
seed = 5
flights = {flights}

[set]
duration_s = {duration_s}

[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]
"""


def fly(url: str, text: str) -> tuple[float, str]:
    begun = time.monotonic()
    job = ask(f"{url}/api/v1/campaigns", {"text": text})
    done = wait(f"{url}/api/v1/campaigns/{job['id']}", pause_s=0.05)
    return time.monotonic() - begun, done["result"]["hash"]


class Processors:
    """Processor time, s, of a server (`server`), of what flies for it (`flights`), and of the rest of a cluster (`Ray`)."""

    def __init__(self, server: int, cluster: int | None) -> None:
        self.server, self.cluster = server, cluster
        self.seen: dict[tuple[int, str], float] = {}
        self.look()
        self.at_start = dict(self.seen)
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.watch, daemon=True)
        self.thread.start()

    def watch(self) -> None:
        while not self.stop.wait(0.1):
            self.look()

    def look(self) -> None:
        found = {}
        for name in filter(str.isdigit, os.listdir("/proc")):
            try:
                fields = Path(f"/proc/{name}/stat").read_text().rsplit(")", 1)[1].split()
                words = Path(f"/proc/{name}/cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            ticks = os.sysconf("SC_CLK_TCK")
            found[int(name)] = (int(fields[1]), words, sum(map(int, fields[11:13])) / ticks, sum(map(int, fields[13:15])) / ticks)
        for pid, (_, words, own, of_children) in found.items():
            above = pid
            while above in found and above not in (self.server, self.cluster):
                above = found[above][0]
            if pid == self.server:
                self.seen[pid, "server"], self.seen[pid, "flights"] = own, of_children
            elif above == self.cluster and words[1:2] == [b"part"]:
                self.seen[pid, "flights"] = own + of_children
            elif above == self.cluster and words[1:2] != [b"job"]:
                self.seen[pid, "Ray"] = own

    def end(self) -> dict[str, float]:
        self.stop.set()
        self.thread.join()
        self.look()
        sums = {"server": 0.0, "flights": 0.0, "Ray": 0.0}
        for (pid, kind), seconds in self.seen.items():
            sums[kind] += seconds - self.at_start.get((pid, kind), 0.0)
        return sums


def on_disk(folder: Path) -> int:
    """Bytes that a folder takes, with all below it."""
    return sum(file.stat().st_blocks * 512 for file in folder.rglob("*") if file.is_file())


def interval(values: list[float]) -> tuple[float, float, float]:
    """Geometric mean, and an interval of 95 %."""
    logs = [math.log(value) for value in values]
    middle = statistics.fmean(logs)
    if len(logs) < 2:
        return math.exp(middle), 0.0, math.inf
    student = {2: 12.71, 3: 4.30, 4: 3.18, 5: 2.78, 6: 2.57, 7: 2.45, 8: 2.36, 9: 2.31, 10: 2.26}.get(len(logs), 2.23)
    half = student * statistics.stdev(logs) / math.sqrt(len(logs))
    return math.exp(middle), math.exp(middle - half), math.exp(middle + half)


def quiet(dashboard: str) -> None:
    """Waits for what Ray still has to start or to end, which nobody else waits for: the next turn is not to pay for it."""
    end = time.monotonic() + 120.0
    while any(job["status"] in ("PENDING", "RUNNING") for job in ask(f"{dashboard}/api/jobs/") if job["type"] == "SUBMISSION"):
        assert time.monotonic() < end, f"{dashboard}: submissions have not ended within 120 s"
        time.sleep(0.2)


def main() -> None:
    flights, duration_s, turns = (int(word) for word in (sys.argv[1:] + ["10000", "20", "3"][len(sys.argv) - 1 :]))
    text = DOCUMENT.format(flights=flights, duration_s=float(duration_s))
    environment = os.environ | {"RAY_USAGE_STATS_ENABLED": "0"}
    command = [sys.executable, str(ROOT / "tests/src/ray_cluster.py")]
    cluster = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
    servers = []
    try:
        with tempfile.TemporaryDirectory() as folder:
            assert cluster.stdout is not None
            dashboard = json.loads(cluster.stdout.readline())["dashboard"]
            ray = ["--executor", f"ray={dashboard}", "--ray-program", PROGRAM, "--ray-parts", "4"]
            servers = [("workers", *serve(f"{folder}/own", ["--workers", "2"])), ("ray", *serve(f"{folder}/ray", ["--workers", "2", *ray]))]
            times: dict[str, list[float]] = {name: [] for name, *_ in servers}
            used: dict[str, list[dict[str, float]]] = {name: [] for name, *_ in servers}
            hashes = set()
            print(f"{flights} flights of {duration_s} s, in turns; load {os.getloadavg()[0]:.1f} at the start, {os.cpu_count()} cores", flush=True)
            for turn in range(turns + 1):
                for name, process, url in servers:
                    processors = Processors(process.pid, cluster.pid if name == "ray" else None)
                    seconds, result = fly(url, text)
                    quiet(dashboard)
                    sums = processors.end()
                    hashes.add(result)
                    shown = ", ".join(f"{kind} {value:.1f}" for kind, value in sums.items())
                    counted = "not counted" if turn == 0 else f"turn {turn}"
                    load = os.getloadavg()[0]
                    print(f"{counted:12} {name:8} {seconds:7.2f} s {flights / seconds:7.1f} flights/s, processor s: {shown}; load {load:.1f}", flush=True)
                    if turn > 0:
                        times[name].append(seconds)
                        used[name].append(sums)
            assert len(hashes) == 1, hashes
            median = {name: statistics.median(values) for name, values in times.items()}
            print(f"median: workers {median['workers']:.2f} s, ray {median['ray']:.2f} s; ray has {median['workers'] / median['ray']:.2f} of the speed")
            for what, ratios in (
                ("of the wall", [own / ray for own, ray in zip(times["workers"], times["ray"], strict=True)]),
                ("of the processors", [sum(own.values()) / sum(ray.values()) for own, ray in zip(used["workers"], used["ray"], strict=True)]),
            ):
                mean, low, high = interval(ratios)
                print(f"workers / ray, seconds {what}: {mean:.2f} [{low:.2f}, {high:.2f}], n = {len(ratios)}")
            print(f"disk: {', '.join(f'{name} {on_disk(Path(folder) / place) / 1e6:.0f} MB' for name, place in (('workers', 'own'), ('ray', 'ray')))}")
            print(f"load {os.getloadavg()[0]:.1f} at the end; all results have the same hash")
            for _, process, _ in servers:
                process.terminate()
                process.wait(timeout=30)
    finally:
        for _, process, _ in servers:
            process.kill()
        assert cluster.stdin is not None
        cluster.stdin.close()
        cluster.wait(timeout=60)


if __name__ == "__main__":
    main()
