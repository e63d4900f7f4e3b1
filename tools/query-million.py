"""How long a server takes to answer SQL over a campaign of 1,000,000 flights, and how much memory: over HTTP, and with the Python client.

    cargo build --release --locked -p rotortwin-network
    cargo test --release --locked -p rotortwin-tests --test server_query        # makes the environment with DuckDB
    target/python-client/bin/python tools/query-million.py [ROWS [TURNS]]

A campaign of 320 flights is flown by a server of its own. Its `campaign.parquet` is then made a million rows long: each row of it many times, with a
flight number, a run hash and noise on every number of its own (DuckDB, seed 0.5), so that it packs no better than real rows. The rows are
not flown; the file is what is asked. Memory is the largest sum over the server's child processes, looked up every 5 ms.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import duckdb

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "clients/python/src"))
import rotortwin  # noqa: E402

PROGRAM = os.environ.get("ROTORTWIN_PROGRAM", str(ROOT / "target/release/rotortwin-network"))
DOCUMENT = """
name = "million"
description = "rows to ask"
scenario = "../scenarios/short-hover.toml"
seed = 5
flights = 320

[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]
"""
QUERIES = {
    "by group": "SELECT round(charge, 1) AS charge, count(*) AS flights, avg(sequential_isolated_after_s) AS isolated_after_s FROM campaign GROUP BY 1 ORDER BY 1",
    "distinct": "SELECT count(DISTINCT run_hash) AS hashes FROM campaign",
    "worst": "SELECT * FROM campaign ORDER BY charge DESC LIMIT 100",
}


def ask(url: str, body: object = None) -> dict:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data=data, headers={"content-type": "application/json"})
    try:
        with urllib.request.urlopen(request, timeout=120) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        sys.exit(f"{url}: {error.code} {error.read().decode()}")


def lengthen(file: Path, rows: int) -> None:
    query = duckdb.connect()
    query.execute("SELECT setseed(0.5)")
    columns = query.execute(f"DESCRIBE SELECT * FROM '{file}'").fetchall()
    picks = []
    for name, kind, *_ in columns:
        if name == "flight":
            picks.append(f'CAST(row_number() OVER () - 1 AS {kind}) AS "{name}"')
        elif name == "run_hash":
            picks.append(f'md5(CAST(n AS VARCHAR) || "{name}") AS "{name}"')
        elif kind in ("DOUBLE", "FLOAT"):
            picks.append(f'"{name}" * (1.0 + 0.01 * random()) AS "{name}"')
        else:
            picks.append(f'"{name}"')
    longer = file.with_suffix(".longer")
    source = f"'{file}', range({-(-rows // 320)}) AS t(n)"
    query.execute(f"COPY (SELECT {', '.join(picks)} FROM {source} LIMIT {rows}) TO '{longer}' (FORMAT parquet)")
    longer.replace(file)
    print(f"{rows} rows of {len(columns)} columns, {file.stat().st_size / 1e6:.0f} MB", flush=True)


def resident(parent: int) -> int:
    """Bytes of all descendants of a process."""
    parents, sizes = {}, {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            parents[int(entry.name)], sizes[int(entry.name)] = int(fields[1]), int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    total = 0
    for child in parents:
        above = parents[child]
        while above not in (0, parent):
            above = parents.get(above, 0)
        total += sizes[child] if above == parent else 0
    return total


def main() -> None:
    rows, turns = (int(word) for word in (sys.argv[1:] + ["1000000", "5"][len(sys.argv) - 1 :]))
    with tempfile.TemporaryDirectory() as data:
        command = [PROGRAM, "serve", "--listen", "127.0.0.1:0", "--data", data, "--library", str(ROOT / "config")]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"ROTORTWIN_PYTHON": sys.executable})
        try:
            assert server.stdout is not None
            url = server.stdout.readline().split()[-1]
            job = ask(f"{url}/api/v1/campaigns", {"text": DOCUMENT})["id"]
            while ask(f"{url}/api/v1/campaigns/{job}")["status"] != "done":
                time.sleep(0.2)
            lengthen(next(Path(data).glob(f"jobs/{job}/*/out/campaign.parquet")), rows)
            peak, stop = [0], threading.Event()

            def watch() -> None:
                while not stop.wait(0.005):
                    peak[0] = max(peak[0], resident(server.pid))

            watcher = threading.Thread(target=watch)
            watcher.start()
            print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores, {turns} turns")
            with rotortwin.Client(url) as client:
                for name, sql in QUERIES.items():
                    for way, query in (
                        ("HTTP", lambda sql=sql: ask(f"{url}/api/v1/queries", {"sql": sql, "campaigns": [job]})),
                        ("client", lambda sql=sql: client.query(sql, campaigns=[job])),
                    ):
                        peak[0], times = 0, []
                        for _ in range(turns):
                            begun = time.monotonic()
                            query()
                            times.append(time.monotonic() - begun)
                        print(f"{name:9} {way:7} median {statistics.median(times):.2f} s, at most {max(times):.2f} s, memory {peak[0] / 2**20:.0f} MiB", flush=True)
            stop.set()
            watcher.join()
        finally:
            server.kill()
            server.wait()


if __name__ == "__main__":
    main()
