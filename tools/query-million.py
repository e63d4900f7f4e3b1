"""How long SQL over the rows of 1,000,000 flights takes, and how much memory: by the command, over HTTP, with the Python client, in Python.

    cargo build --release --locked -p rotortwin-network
    cargo test --release --locked -p rotortwin-tests --test server_query        # makes the environment with DuckDB
    target/python-client/bin/python tools/query-million.py [ROWS [TURNS [CAMPAIGNS]]]

A server of its own flies CAMPAIGNS (20) campaigns of 320 flights. The `campaign.parquet` of each is then made longer, so that there are a
million rows in all: each row of it many times, with a flight number, a run hash and noise on every measure of its own (DuckDB, seed
0.5), so that it packs no better than real rows. These rows were not flown; the files are what is asked, all of them by each query: the command and
Python in the folder where the server keeps them, HTTP and the client by the ids of the campaigns. In each turn every way has one query after the other.

The command asks the same files in an object store, too: moto on this machine, a server in Python, if the test `campaign_store` has made its
environment (target/s3-environment). It has --memory 900, as the default of 512 MB is too
little for a million rows from a store. It shows what has to be fetched, not how fast a real store is.

Memory is the largest sum over the processes that answer, looked up every 5 ms: children of the server, or the command or Python with theirs.
"""

import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import duckdb
from pyarrow import fs

from served import PROGRAM, ROOT, ask, serve, wait

sys.path.insert(0, str(ROOT / "clients/python/src"))
import rotortwin  # noqa: E402

DOCUMENT = """
name = "million"
description = "rows to ask"
scenario = "../scenarios/short-hover.toml"
seed = {seed}
flights = 320

[set]
duration_s = 20.0
fault = [{{ time_s = 12.0, rotor = 1, thrust_loss_percent = 5.0 }}]

[[axis]]
name = "charge"
key = "initial.state_of_charge"
uniform = [0.5, 1.0]

[[axis]]
name = "rotor"
key = "fault[0].rotor"
rotors = true
pick = "any"

[[axis]]
name = "loss_percent"
key = "fault[0].thrust_loss_percent"
log_uniform = [1.0, 30.0]

[[axis]]
name = "onset_s"
key = "fault[0].time_s"
uniform = [11.0, 15.0]

[[axis]]
name = "gust_force_n"
key = "mismatch.disturbance_force_rms_n"
uniform = [0.0, 1.5]
"""
QUERIES = {
    "by group": (
        "SELECT rotor, round(charge, 1) AS charge, count(*) AS flights, avg(sequential_isolated_after_s) AS delay_s, "
        "quantile_cont(loss_percent, 0.9) AS loss_percent FROM campaign GROUP BY 1, 2 ORDER BY 1, 2"
    ),
    "distinct": "SELECT count(DISTINCT run_hash) AS hashes FROM campaign",
    "worst": "SELECT * FROM campaign ORDER BY sequential_isolated_after_s DESC NULLS LAST LIMIT 100",
}


def lengthen(file: Path, rows: int) -> int:
    query = duckdb.connect()
    query.execute("SELECT setseed(0.5)")
    columns = query.execute(f"DESCRIBE SELECT * FROM '{file}'").fetchall()
    picks = []
    for name, kind, *_ in columns:
        if name == "flight":
            picks.append(f'CAST(row_number() OVER () - 1 AS {kind}) AS "{name}"')
        elif name == "run_hash":
            picks.append(f'md5(CAST(n AS VARCHAR) || "{name}") AS "{name}"')
        elif kind in ("DOUBLE", "FLOAT") and name != "rotor":
            picks.append(f'"{name}" * (1.0 + 0.01 * random()) AS "{name}"')
        else:
            picks.append(f'"{name}"')
    longer = file.with_suffix(".longer")
    source = f"'{file}', range({-(-rows // 320)}) AS t(n)"
    query.execute(f"COPY (SELECT {', '.join(picks)} FROM {source} LIMIT {rows}) TO '{longer}' (FORMAT parquet)")
    longer.replace(file)
    return len(columns)


def resident(parent: int, with_itself: bool) -> int:
    """Bytes of all descendants of a process, and of itself."""
    parents, sizes = {}, {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            parents[int(entry.name)], sizes[int(entry.name)] = int(fields[1]), int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    total = sizes.get(parent, 0) if with_itself else 0
    for child in parents:
        above = parents[child]
        while above not in (0, parent):
            above = parents.get(above, 0)
        total += sizes[child] if above == parent else 0
    return total


class Peak:
    """The largest memory of a process and its descendants; of the server, of its descendants alone."""

    def __init__(self, server: int) -> None:
        self.server, self.pid, self.bytes = server, server, 0
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.look, daemon=True)
        self.thread.start()

    def watches(self, pid: int) -> None:
        self.pid = pid

    def look(self) -> None:
        while not self.stop.wait(0.005):
            self.bytes = max(self.bytes, resident(self.pid, with_itself=self.pid != self.server))

    def ends(self) -> None:
        self.stop.set()
        self.thread.join()


class Store:
    """An S3-compatible store with the results of the campaigns."""

    PROGRAM = ROOT / "target/s3-environment/bin/moto_server"

    def __init__(self, results: dict[str, Path]) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.child = subprocess.Popen([self.PROGRAM, "-H", "127.0.0.1", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        endpoint = f"http://127.0.0.1:{port}"
        self.environment = {
            "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": "us-east-1", "AWS_ENDPOINT": endpoint, "AWS_ALLOW_HTTP": "true",
        }
        for _ in range(600):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.1)
        files = fs.S3FileSystem(access_key="test", secret_key="test", region="us-east-1", endpoint_override=endpoint, allow_bucket_creation=True)
        files.create_dir("bench")
        for name, file in results.items():
            with files.open_output_stream(f"bench/million/{name}/campaign.parquet") as out:
                out.write(file.read_bytes())

    address = "s3://bench/million"


def asked_by(url: str, jobs: list[str], folder: str, store: Store | None) -> dict[str, Callable[[str, Peak], None]]:
    """Each way to ask, by its name."""
    client = rotortwin.Client(url)
    environment = os.environ | {"ROTORTWIN_PYTHON": sys.executable, "PYTHONPATH": str(ROOT / "clients/python/src")}

    def process(peak: Peak, words: list[str], more: dict[str, str] | None = None) -> None:
        child = subprocess.Popen(words, stdout=subprocess.PIPE, env=environment | (more or {}))
        peak.watches(child.pid)
        assert child.stdout is not None
        answer = child.stdout.read()
        assert child.wait() == 0 and answer, words

    def command(sql: str, peak: Peak) -> None:
        process(peak, [PROGRAM, "query", "--json", sql, folder])

    def python(sql: str, peak: Peak) -> None:
        process(peak, [sys.executable, "-c", "import rotortwin, sys; print(rotortwin.query(*sys.argv[1:]).num_rows)", sql, folder])

    def bucket(sql: str, peak: Peak) -> None:
        process(peak, [PROGRAM, "query", "--json", "--memory", "900", sql, Store.address], store and store.environment)

    return {
        "command": command,
        **({"bucket": bucket} if store else {}),
        "HTTP": lambda sql, peak: (ask(f"{url}/api/v1/queries", {"sql": sql, "campaigns": jobs}), None)[1],
        "client": lambda sql, peak: (client.query(sql, campaigns=jobs), None)[1],
        "python": python,
    }


def main() -> None:
    rows, turns, campaigns = (int(word) for word in (sys.argv[1:] + ["1000000", "5", "20"][len(sys.argv) - 1 :]))
    with tempfile.TemporaryDirectory() as data:
        server, url = serve(data, [])
        store = None
        try:
            jobs = [ask(f"{url}/api/v1/campaigns", {"text": DOCUMENT.format(seed=5 + n)})["id"] for n in range(campaigns)]
            for job in jobs:
                wait(f"{url}/api/v1/campaigns/{job}", pause_s=0.2)
            size, results = 0, {}
            for n, job in enumerate(jobs):
                file = next(Path(data).glob(f"jobs/{job}/*/out/campaign.parquet"))
                columns = lengthen(file, rows // campaigns + (n < rows % campaigns))
                size += file.stat().st_size
                results[job] = file
            print(f"{rows} rows of {columns} columns in {campaigns} files, {size / 1e6:.0f} MB", flush=True)
            print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores, {turns} turns", flush=True)
            counted = ask(f"{url}/api/v1/queries", {"sql": "SELECT count(*), count(DISTINCT run_hash) FROM campaign", "campaigns": jobs})["rows"]
            assert counted == [[rows, rows]], counted
            store = Store(results) if Store.PROGRAM.exists() else None
            ways = asked_by(url, jobs, data, store)
            found: dict[tuple[str, str], list[tuple[float, int]]] = {}
            for _ in range(turns):
                for name, sql in QUERIES.items():
                    for way, query in ways.items():
                        peak, begun = Peak(server.pid), time.monotonic()
                        query(sql, peak)
                        seconds = time.monotonic() - begun
                        peak.ends()
                        found.setdefault((name, way), []).append((seconds, peak.bytes))
            for (name, way), values in found.items():
                times = [seconds for seconds, _ in values]
                memory = max(peak for _, peak in values) / 2**20
                print(f"{name:9} {way:8} median {statistics.median(times):.2f} s, at most {max(times):.2f} s, memory {memory:.0f} MiB")
            print(f"load {os.getloadavg()[0]:.1f} at the end")
        finally:
            for child in [server, *([store.child] if store else [])]:
                child.kill()
                child.wait()


if __name__ == "__main__":
    main()
