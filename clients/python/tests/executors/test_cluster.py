"""Campaigns on Ray and Dask, of whose nodes some die."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import rotortwin

from campaigns import assert_same, fly_here, write
from conftest import ROOT, program

ray = pytest.importorskip("ray")


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A campaign of 12 shards, and its results from one machine."""
    folder = tmp_path_factory.mktemp("campaign")
    file = write(folder / "own", ROOT, flights=12 * 32, duration_s=20.0)
    fly_here(program(), file, folder / "one")
    return file, folder / "one"


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A Ray cluster of a head and two nodes of one CPU each, which the tests below share in their order: starting one takes most of their time."""
    from ray.cluster_utils import Cluster

    memory = {"object_store_memory": 100 << 20}
    for is_last in (False, False, False, False, True):
        cluster: Any = Cluster()
        try:
            # The head flies nothing, so that lost tasks are flown by the remaining node.
            cluster.add_node(num_cpus=0, include_dashboard=False, **memory)
            for _ in range(2):
                cluster.add_node(num_cpus=1, **memory)
            break
        except Exception as error:
            # Ray waits 30 s for a node, which is too short on a crowded machine.
            cluster.shutdown()
            if is_last or "timed out during startup" not in str(error):
                raise
    yield cluster
    cluster.shutdown()


def test_scenario_a_ray_node_dies_in_mid_campaign(cluster: Any, here: tuple[Path, Path], tmp_path: Path) -> None:
    file, one = here
    victim = next(iter(cluster.worker_nodes))
    ray.init(address=cluster.address, log_to_driver=False)
    try:
        killed: list[float] = []

        def progress(present: int, _all: int) -> None:
            if present >= 3 and not killed:
                killed.append(time.monotonic())
                cluster.remove_node(victim, allow_graceful=False)

        table = rotortwin.campaign(file, executor="ray", out=tmp_path / "ray", shards_per_task=1, memory=200 << 20, program=program(), progress=progress)
        assert killed, "no node was killed"
        # The head detects a death by a broken connection or by failed health checks.
        end = time.monotonic() + 60.0
        while len([node for node in ray.nodes() if node["Alive"]]) != 2:
            assert time.monotonic() < end, "the head still takes the killed node for alive"
            time.sleep(0.2)
    finally:
        ray.shutdown()
    assert table.num_rows == 12 * 32
    assert_same(one, tmp_path / "ray")


DRIVER = """
import sys
import rotortwin
file, out, program = sys.argv[1:]
print("begun", flush=True)
rotortwin.campaign(file, executor="ray", out=out, shards_per_task=1, program=program, progress=lambda present, _all: print(present, flush=True))
"""


def test_scenario_a_killed_driver_goes_on_where_it_was(cluster: Any, here: tuple[Path, Path], tmp_path: Path) -> None:
    file, one = here
    environment = {**os.environ, "RAY_ADDRESS": cluster.address}
    words = [sys.executable, "-c", DRIVER, str(file), str(tmp_path / "ray"), program()]
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) as driver:
        assert driver.stdout is not None
        seen = [line.strip() for line in iter(driver.stdout.readline, "3\n") if line]
        driver.kill()
    assert "12" not in seen, "it was not killed half-way"
    again = subprocess.run(words, env=environment, stdout=subprocess.PIPE, text=True, timeout=900, check=True)
    counts = [int(word) for word in again.stdout.split() if word.isdigit()]
    assert counts[0] >= 3, f"it began anew: {counts}"
    assert_same(one, tmp_path / "ray")


def test_scenario_what_the_program_refuses_is_not_tried_again(cluster: Any, here: tuple[Path, Path], tmp_path: Path) -> None:
    file, _ = here
    ray.init(address=cluster.address, log_to_driver=False)
    try:
        # Another version of the program, which this node lacks.
        other = tmp_path / "rotortwin"
        other.write_text(f'#!/bin/sh\ncase "$*" in *--shards*) echo "rotortwin: not here" >&2; exit 2;; esac\nexec {program()} "$@"\n')
        other.chmod(0o755)
        with pytest.raises(rotortwin.CampaignFailed, match="not here"):
            rotortwin.campaign(file, executor=ray, program=str(other))
    finally:
        ray.shutdown()


def test_scenario_a_dask_worker_dies_in_mid_campaign(here: tuple[Path, Path], tmp_path: Path) -> None:
    distributed: Any = pytest.importorskip("distributed")
    file, one = here
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, distributed.Client(cluster) as client:
        killed: list[int] = []

        def progress(present: int, _all: int) -> None:
            if present >= 3 and not killed:
                worker = next(iter(cluster.workers.values()))
                killed.append(worker.pid)
                worker.process.process._process.kill()

        table = rotortwin.campaign(file, executor=client, out=tmp_path / "dask", shards_per_task=1, program=program(), progress=progress)
    assert killed
    assert table.num_rows == 12 * 32
    assert_same(one, tmp_path / "dask")
