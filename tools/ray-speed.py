"""How fast a Ray cluster flies a campaign for a server, against the server's own workers: the same campaign, the same two cores, in turns.

    cargo build --release --locked -p rotortwin-network
    cargo test --release --locked -p rotortwin-tests --test ray_executor        # makes the environment with Ray
    target/executors-environment/bin/python tools/ray-speed.py [FLIGHTS [SECONDS [TURNS]]]

Starts a cluster of this machine (a head that flies nothing, two nodes of one CPU), one server with `--workers 2`, one with the same and
`--executor ray=… --ray-parts 4`, and measures from the submission to the end of the campaign, turn by turn. Seeds are those of the campaign (5). The first
pair is not counted. Prints seconds, flights a second, and the ratio of the medians.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = os.environ.get("ROTORTWIN_PROGRAM", str(ROOT / "target/release/rotortwin-network"))
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


def ask(url: str, body: object = None) -> dict:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data=data, headers={"content-type": "application/json"})
    with urllib.request.urlopen(request, timeout=60) as answer:
        return json.load(answer)


def serve(data: str, words: list[str]) -> tuple[subprocess.Popen, str]:
    command = [PROGRAM, "serve", "--listen", "127.0.0.1:0", "--data", data, "--library", str(ROOT / "config"), "--workers", "2", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, process.stdout.readline().split()[-1]


def fly(url: str, text: str) -> tuple[float, str]:
    begun = time.monotonic()
    job = ask(f"{url}/api/v1/campaigns", {"text": text})
    while True:
        now = ask(f"{url}/api/v1/campaigns/{job['id']}")
        if now["status"] not in ("queued", "running"):
            break
        time.sleep(0.05)
    assert now["status"] == "done", now
    return time.monotonic() - begun, now["result"]["hash"]


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
            servers = [("workers", *serve(f"{folder}/own", [])), ("ray", *serve(f"{folder}/ray", ray))]
            times: dict[str, list[float]] = {name: [] for name, *_ in servers}
            hashes = set()
            print(f"{flights} flights of {duration_s} s, in turns; load {os.getloadavg()[0]:.1f} at the start, {os.cpu_count()} cores", flush=True)
            for turn in range(turns + 1):
                for name, _, url in servers:
                    seconds, result = fly(url, text)
                    hashes.add(result)
                    print(f"{'not counted' if turn == 0 else f'turn {turn}':12} {name:8} {seconds:7.2f} s {flights / seconds:7.1f} flights/s", flush=True)
                    if turn > 0:
                        times[name].append(seconds)
            assert len(hashes) == 1, hashes
            median = {name: statistics.median(values) for name, values in times.items()}
            print(f"median: workers {median['workers']:.2f} s, ray {median['ray']:.2f} s; ray has {median['workers'] / median['ray']:.2f} of the speed")
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
