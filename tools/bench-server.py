#!/usr/bin/env python3
"""Load on a real server over loopback; prints what docs/server.md says.

  tools/bench-server.py [--program target/release/rotortwin-network] [--watchers 1000] [--submissions 1000] [--runs 10000]

1. Submissions per second (one after the other, and 8 at a time), each on disk before it is answered.
2. From the answer 202 to the event `started`, with an idle worker: median and 99th percentile of 200.
3. Many watchers of one run's events: how many saw every event.
4. A list and a table of many runs (copies of a real one, put into the database): how long an answer takes.
Nothing but Python's standard library is needed.
"""

import argparse
import asyncio
import http.client
import json
import pathlib
import re
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent


class Server:
    def __init__(self, program, data, *more):
        command = [program, "serve", "--listen", "127.0.0.1:0", "--data", data, "--library", ROOT / "config", *more]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
        line = self.process.stdout.readline()
        match = re.search(r"http://([\d.]+):(\d+)", line)
        if not match:
            sys.exit(f"the server did not say where it serves: {line!r}")
        self.host, self.port = match[1], int(match[2])

    def stop(self):
        self.process.terminate()
        self.process.wait(timeout=30)

    def connection(self):
        return http.client.HTTPConnection(self.host, self.port, timeout=60)


def ask(connection, method, path, body=None):
    headers = {"content-type": "application/json"} if body else {}
    connection.request(method, path, json.dumps(body) if body else None, headers)
    answer = connection.getresponse()
    text = answer.read()
    if answer.status >= 400:
        sys.exit(f"{method} {path}: {answer.status} {text[:300]!r}")
    return json.loads(text)


def ended(connection, run, pause_s):
    """The run once it is neither queued nor running."""
    while run["status"] in ("queued", "running"):
        time.sleep(pause_s)
        run = ask(connection, "GET", f"/api/v1/runs/{run['id']}")
    return run


def percentile(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, int(share * len(values)))]


def submissions(program, folder, count):
    """Without workers: only the submissions cost."""
    server = Server(program, folder / "submissions", "--workers", "0", "--rate", "1000000")
    body = {"scenario": "short-hover"}
    connection = server.connection()
    begun = time.perf_counter()
    for _ in range(count // 4):
        ask(connection, "POST", "/api/v1/runs", body)
    alone = (count // 4) / (time.perf_counter() - begun)

    def many():
        own = server.connection()
        for _ in range(count // 8):
            ask(own, "POST", "/api/v1/runs", body)

    threads = [threading.Thread(target=many) for _ in range(8)]
    begun = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    together = 8 * (count // 8) / (time.perf_counter() - begun)
    server.stop()
    print(f"submissions per second, each on disk: {alone:.0f} one after the other, {together:.0f} from 8 clients")


def start_latency(program, folder, count):
    server = Server(program, folder / "starts", "--workers", "1")
    connection = server.connection()
    delays = []
    for seed in range(count):
        run = ask(connection, "POST", "/api/v1/runs", {"scenario": "short-hover", "seed": seed, "link": "in-process"})
        run = ended(connection, run, 0.002)
        delays.append(run["started_ms"] - run["submitted_ms"])
    server.stop()
    print(f"submission to start, idle worker, {count} runs: median {percentile(delays, 0.5)} ms, p99 {percentile(delays, 0.99)} ms")


async def watch(host, port, path, ids):
    reader, writer = await asyncio.open_connection(host, port)
    writer.write(f"GET {path} HTTP/1.0\r\nhost: {host}\r\n\r\n".encode())
    await writer.drain()
    async for line in reader:
        if line.startswith(b"id: "):
            ids.append(int(line[4:]))
    writer.close()


async def watchers(server, count):
    connection = server.connection()
    body = {"scenario": "short-hover", "pace": "real-time", "set": ["duration_s=8.0"]}
    run = ask(connection, "POST", "/api/v1/runs", body)
    seen = [[] for _ in range(count)]
    path = f"/api/v1/runs/{run['id']}/events"
    await asyncio.gather(*(watch(server.host, server.port, path, ids) for ids in seen))
    run = ask(connection, "GET", f"/api/v1/runs/{run['id']}")
    late = []
    await watch(server.host, server.port, path, late)
    whole = sum(ids == late for ids in seen)
    print(f"{count} watchers of one run ({run['status']}, {len(late)} events): {whole} saw every event in order")
    return whole == count and late == list(range(1, len(late) + 1))


def tables(program, folder, count):
    data = folder / "table"
    server = Server(program, data, "--workers", "1")
    connection = server.connection()
    run = ask(connection, "POST", "/api/v1/runs", {"scenario": "reference-flight", "link": "in-process"})
    run = ended(connection, run, 0.05)
    server.stop()
    database = sqlite3.connect(data / "rotortwin.sqlite")
    columns = [row[1] for row in database.execute("PRAGMA table_info(job)")]
    row = dict(zip(columns, database.execute("SELECT * FROM job").fetchone()))
    with database:
        for number in range(count - 1):
            copy = dict(row, id=f"{number:032x}")
            marks = ",".join("?" * len(columns))
            database.execute(f"INSERT INTO job ({','.join(columns)}) VALUES ({marks})", [copy[name] for name in columns])
    database.close()
    server = Server(program, data, "--workers", "0")
    connection = server.connection()
    names = ask(connection, "GET", "/api/v1/table")["rows"][0][:10]
    for what, path in [
        (f"list, first page of 1000 of {count}", "/api/v1/runs?limit=1000"),
        (f"table of {count} runs × 10 numbers", f"/api/v1/table?limit={count}&columns={','.join(names)}"),
    ]:
        times = []
        for _ in range(5):
            begun = time.perf_counter()
            answer = ask(connection, "GET", path)
            times.append(time.perf_counter() - begun)
        rows = len(answer.get("rows") or answer.get("items"))
        print(f"{what}: {percentile(times, 0.5) * 1000:.0f} ms ({rows} rows)")
    begun = time.perf_counter()
    rows, cursor = 0, ""
    while True:
        page = ask(connection, "GET", f"/api/v1/runs?limit=1000{cursor}")
        rows += len(page["items"])
        if not page.get("next"):
            break
        cursor = f"&cursor={page['next']}"
    print(f"list of all {rows} runs in pages of 1000: {(time.perf_counter() - begun) * 1000:.0f} ms")
    server.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default=ROOT / "target/release/rotortwin-network")
    parser.add_argument("--watchers", type=int, default=1000)
    parser.add_argument("--submissions", type=int, default=1000)
    parser.add_argument("--starts", type=int, default=200)
    parser.add_argument("--runs", type=int, default=10_000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        submissions(arguments.program, folder, arguments.submissions)
        start_latency(arguments.program, folder, arguments.starts)
        server = Server(arguments.program, folder / "watchers", "--workers", "1")
        complete = asyncio.run(watchers(server, arguments.watchers))
        server.stop()
        tables(arguments.program, folder, arguments.runs)
        if not complete:
            sys.exit("events were lost")


if __name__ == "__main__":
    main()
