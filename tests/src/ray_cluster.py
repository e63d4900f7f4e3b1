"""A Ray cluster of this machine for the tests: a head that does nothing and two nodes of one CPU each.

Says as a line of JSON where its dashboard is, then takes commands, one a line: `kill N` kills the raylet of a node with -9, and all that it has
started, as where a machine dies; `add N` adds a node in its place. Ends with its standard input. An argument is the port of the dashboard; without one it is a free one. With RAY_AUTH_MODE=token
in the environment it asks for the token RAY_AUTH_TOKEN.
"""

import json
import os
import signal
import socket
import sys
import tempfile
import time
import urllib.error
import urllib.request

# Ray finds "its" cluster by a file in this folder, which two clusters on one host would share. (Socket paths must be short.)
TEMPORARY = tempfile.TemporaryDirectory(prefix="ray-")
os.environ["RAY_TMPDIR"] = TEMPORARY.name

from ray._private.ray_constants import PROCESS_TYPE_RAYLET  # noqa: E402
from ray.cluster_utils import Cluster  # noqa: E402

# A silent node is considered dead after 5 to 10 s instead of 15 to 20: the tests wait for that, on a possibly busy machine.
QUICK = {"health_check_period_ms": 1000, "health_check_timeout_ms": 5000, "health_check_failure_threshold": 5}


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def descendants(ancestor: int) -> list[int]:
    parents = {}
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{name}/stat") as file:
                parents[int(name)] = int(file.read().rsplit(")", 1)[1].split()[1])
        except OSError:
            continue
    found, open_ones = [], [ancestor]
    while open_ones:
        parent = open_ones.pop()
        children = [child for child, above in parents.items() if above == parent]
        found += children
        open_ones += children
    return found


def kill_all(processes: list[int]) -> None:
    for process in processes:
        try:
            os.kill(process, signal.SIGKILL)
        except ProcessLookupError:
            continue


def kill(cluster: Cluster, node: object) -> None:
    left = descendants(node.all_processes[PROCESS_TYPE_RAYLET][0].process.pid)
    cluster.remove_node(node, allow_graceful=False)
    kill_all(left)


def started(head: dict) -> Cluster:
    """A cluster of a head. Ray waits 30 s for a node, which is too short on a crowded machine."""
    for is_last in (False, False, False, False, True):
        cluster = Cluster()
        try:
            cluster.add_node(**head)
            return cluster
        except Exception as error:
            # The dashboard would keep its port.
            kill_all(descendants(os.getpid()))
            if is_last or "timed out during startup" not in str(error):
                raise


def main() -> None:
    port = int(sys.argv[1]) if len(sys.argv) > 1 else free_port()
    url = f"http://127.0.0.1:{port}"
    head = {"num_cpus": 0, "include_dashboard": True, "dashboard_port": port, "object_store_memory": 100 << 20, "_system_config": QUICK}
    cluster = started(head)
    try:
        nodes = [cluster.add_node(num_cpus=1, object_store_memory=100 << 20) for _ in range(2)]
        end = time.monotonic() + 60.0
        while True:
            try:
                headers = {"authorization": f"Bearer {os.environ.get('RAY_AUTH_TOKEN', '')}"}
                urllib.request.urlopen(urllib.request.Request(f"{url}/api/jobs/", headers=headers), timeout=5).read()
                break
            except (urllib.error.URLError, TimeoutError):
                if time.monotonic() > end:
                    raise
                time.sleep(0.2)
        print(json.dumps({"dashboard": url}), flush=True)
        for line in sys.stdin:
            word, _, number = line.strip().partition(" ")
            if word == "kill":
                kill(cluster, nodes[int(number)])
            elif word == "add":
                nodes[int(number)] = cluster.add_node(num_cpus=1, object_store_memory=100 << 20)
            print(json.dumps({"done": line.strip()}), flush=True)
    finally:
        cluster.shutdown()
        TEMPORARY.cleanup()


main()
