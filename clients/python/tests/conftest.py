"""A real server for every test: `rotortwin serve` on a free port, in a folder of its own."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rotortwin import Client

# In-process modules are part of the platform's wheel only; tests/tests/packages.rs runs these tests from it.
collect_ignore = [] if importlib.util.find_spec("rotortwin._native") else ["native"]
# Ray and Dask are in an environment of their own: tests/tests/executors.rs.
collect_ignore += [] if importlib.util.find_spec("ray") else ["executors"]

ROOT = Path(__file__).resolve().parents[3]


def program() -> str:
    """The program under test."""
    named = os.environ.get("ROTORTWIN_PROGRAM")
    built = ROOT / "target/release/rotortwin-network"
    found = named or (str(built) if built.exists() else shutil.which("rotortwin"))
    if found is None:
        pytest.exit(f"no rotortwin program: build {built} or name one with ROTORTWIN_PROGRAM", returncode=2)
    return found


class Server:
    """`rotortwin serve`; may be killed and started again at the same address."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port: int = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        """Starts it and waits until it serves."""
        arguments = ["serve", "--listen", f"127.0.0.1:{self.port}", "--workers", "2", "--data", str(self.folder)]
        self.process = subprocess.Popen(
            [program(), *arguments, "--library", str(ROOT / "config")],
            # SQL runs in the DuckDB of this environment.
            env=os.environ | {"ROTORTWIN_PYTHON": sys.executable},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert re.search(r"http://127\.0\.0\.1:\d+", line), f"the server said {line!r}"

    def kill(self) -> None:
        """kill -9."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def fresh(tmp_path: Path) -> Iterator[Server]:
    """A server of one test."""
    server = Server(tmp_path / "data")
    yield server
    server.kill()


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server of all tests that leave it alive."""
    server = Server(tmp_path_factory.mktemp("data"))
    yield server
    server.kill()


@pytest.fixture
def client(server: Server) -> Iterator[Client]:
    """A client of it."""
    with Client(server.url, patience_s=20.0) as client:
        yield client
