"""A server of its own for the scripts of this folder, asked over HTTP with the standard library only."""

import json
import os
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = os.environ.get("ROTORTWIN_PROGRAM", str(ROOT / "target/release/rotortwin-network"))


def serve(data: str | Path, options: list[str]) -> tuple[subprocess.Popen, str]:
    """Starts a server on a free port; returns its process and its URL."""
    command = [PROGRAM, "serve", "--listen", "127.0.0.1:0", "--data", str(data), "--library", str(ROOT / "config"), *options]
    # Variables of the server alone: NAME=VALUE, with spaces between them.
    more = dict(one.split("=", 1) for one in os.environ.get("ROTORTWIN_SERVER_ENV", "").split())
    environment = os.environ | {"ROTORTWIN_PYTHON": sys.executable} | more
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    words = process.stdout.readline().split()
    if not words:
        sys.exit(f"{PROGRAM}: the server did not start (exit code {process.wait()})")
    return process, words[-1]


def ask(url: str, body: object = None) -> dict:
    """GET, or POST of a JSON body; an error of the server ends the script."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data=data, headers={"content-type": "application/json"})
    try:
        with urllib.request.urlopen(request, timeout=120) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        sys.exit(f"{url}: {error.code} {error.read().decode()}")


def wait(url: str, pause_s: float) -> dict:
    """The job at `url` once it is done; one that fails or is canceled ends the script."""
    while (job := ask(url))["status"] in ("queued", "running"):
        time.sleep(pause_s)
    if job["status"] != "done":
        sys.exit(f"{url}: {job['status']}: {job.get('error')}")
    return job
