"""Campaigns whose shards are flown by an executor: threads and processes of this machine, Ray, Dask, or any other.

    import rotortwin

    table = rotortwin.campaign("wide-draw")                                   # every core of this machine
    table = rotortwin.campaign("mine.toml", executor="ray", threads=2)        # every node of the Ray cluster
    table = rotortwin.campaign("mine.toml", executor=dask.distributed.Client("tcp://bench:8786"))
    table = rotortwin.campaign("wide-draw", detectors=[Mine()])               # a detector of your own next to ours

A shard of 32 flights depends on the campaign and on its number alone. Tasks fly a few shards each with the program `rotortwin` of the place
where they run, and give their bytes; here they are put into one folder, which is that of `rotortwin campaign` on one machine, byte for byte,
whatever the order and whatever died meanwhile. Files that the campaign names travel with the tasks: the nodes need the package `rotortwin`
of the same version, no folder in common.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import fcntl
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import CampaignFailed

if TYPE_CHECKING:
    import pyarrow

    from .detectors import Detector

#: Most tasks submitted to an executor before the first has ended.
_AHEAD = 1000
#: Environment variable with the path of the program; takes precedence over the search.
_PROGRAM = "ROTORTWIN_PROGRAM"


def campaign(
    campaign: str | PathLike[str],
    *,
    executor: Any = None,
    out: str | PathLike[str] | None = None,
    shards_per_task: int = 4,
    threads: int = 1,
    retries: int = 3,
    resources: Mapping[str, float] | None = None,
    memory: int | None = None,
    program: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    detectors: Sequence[Detector] = (),
) -> pyarrow.Table:
    """Flies a campaign (a file, or a name that `rotortwin list campaigns` shows); a row for each flight: `campaign.parquet`.

    executor: None (this machine, in one process), `"ray"` (the cluster that `ray.init` has connected, or connects by itself), a client of
    Dask, or an executor of `concurrent.futures`.
    out: folder of the results, `report.html` among them; what is there of the same campaign is not flown again. By default nothing is kept.
    shards_per_task, threads: shards of 32 flights of a task, and processors that it takes.
    retries: how often Ray or Dask begins a task again whose node or process died; others give up, and the same call goes on.
    resources: what a task takes besides processors, as Ray and Dask call it.
    memory: bytes that a task takes, by which Ray schedules it; by default Ray counts none. Dask has no such request: name one in `resources`.
    program: `rotortwin` on the nodes; by default that of the node's package, or else on its search path.
    progress: called with shards that are there and shards of all.
    detectors: of your own (`rotortwin.detectors`); they judge the flights here, after they were flown, and have their columns and rows next to ours.

    Raises CampaignFailed: the campaign cannot be flown, or a task failed; shards that are there stay in `out`.
    """
    import pyarrow.parquet

    if shards_per_task < 1 or threads < 1:
        raise CampaignFailed(f"shards_per_task and threads: expected at least 1, got {shards_per_task} and {threads}")
    if memory is not None and memory < 1:
        raise CampaignFailed(f"memory: expected bytes, at least 1, got {memory}")
    if memory is not None and executor is None:
        raise CampaignFailed("memory: expected executor='ray', on this machine alone nobody schedules by it")
    with contextlib.ExitStack() as ended:
        folder = Path(out) if out is not None else Path(ended.enter_context(tempfile.TemporaryDirectory(prefix="rotortwin-campaign-"))) / "campaign"
        if detectors:
            # Before the flights: a refusal must not cost them.
            from .detectors import judge_campaign, told_apart

            told_apart(detectors)
        _fly_into(campaign, executor, folder, shards_per_task, threads, retries, resources, memory, program, progress)
        if detectors:
            judge_campaign(campaign, detectors, folder)
        return pyarrow.parquet.read_table(folder / "campaign.parquet")


def _fly_into(
    campaign: str | PathLike[str],
    executor: Any,
    out: Path,
    shards_per_task: int,
    threads: int,
    retries: int,
    resources: Mapping[str, float] | None,
    memory: int | None,
    program: str | None,
    progress: Callable[[int, int], None] | None,
) -> None:
    if executor is not None:
        plan = json.loads(_say(program, ["campaign", os.fspath(campaign), "--check", "--json"]))
        with _Folder(out, plan) as folder:
            missing = folder.missing(shards_per_task)
            task = _Task(program, threads, plan["campaign"], {name: Path(name).read_bytes() for name in plan["files"]})
            submit = _submitter(executor, threads, retries, resources, memory)
            for shards in submit(task, missing):
                folder.take(shards)
                if progress is not None:
                    progress(folder.present, plan["shards"])
    # Flies the missing shards, which are none unless everything is flown here, checks every shard, and writes the results.
    _say(program, ["campaign", os.fspath(campaign), "--out", str(out), "--json"])


class _Folder:
    """The folder of a campaign, locked by this process: as in crates/campaign/src/study/folder.rs."""

    def __init__(self, path: Path, plan: Mapping[str, Any]) -> None:
        self._path = path
        self._manifest: str = plan["manifest"]
        self._count: int = plan["shards"]
        self.present = 0

    def __enter__(self) -> _Folder:
        manifest = self._path / "campaign.json"
        if not manifest.exists() and self._path.exists() and any(self._path.iterdir()):
            raise CampaignFailed(f"{self._path}: holds files that are not those of a campaign; expected another folder")
        (self._path / "shards").mkdir(parents=True, exist_ok=True)
        self._lock = (self._path / "campaign.lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            raise CampaignFailed(f"{self._path}: another process is working on this campaign") from error
        if not manifest.exists():
            _write_whole(manifest, self._manifest.encode())
        elif json.loads(manifest.read_text()) != json.loads(self._manifest):
            self._lock.close()
            raise CampaignFailed(
                f"{self._path}: holds flights of another campaign, or of another version of rotortwin; expected another folder"
            )
        return self

    def __exit__(self, *_error: object) -> None:
        # Explicitly: processes of an executor that were forked meanwhile hold the file open, too.
        fcntl.flock(self._lock, fcntl.LOCK_UN)
        self._lock.close()

    def _shard(self, number: int) -> Path:
        return self._path / "shards" / f"{number:06}.parquet"

    def missing(self, most: int) -> list[tuple[int, int]]:
        """Ranges of missing shards, each of at most this length."""
        ranges: list[tuple[int, int]] = []
        for number in range(self._count):
            if self._shard(number).exists():
                self.present += 1
            elif ranges and ranges[-1][1] == number and number - ranges[-1][0] < most:
                ranges[-1] = (ranges[-1][0], number + 1)
            else:
                ranges.append((number, number + 1))
        return ranges

    def take(self, shards: Mapping[str, bytes]) -> None:
        """The result of a task."""
        if json.loads(shards["campaign.json"]) != json.loads(self._manifest):
            raise CampaignFailed(
                "a task flew with another version of rotortwin, or other vehicles, than are here; expected the same package on every node"
            )
        for name, content in shards.items():
            if name.startswith("shards/"):
                _write_whole(self._path / name, content)
                self.present += 1


class _Task:
    """Flies shards on any machine; pickled with the files of its campaign."""

    def __init__(self, program: str | None, threads: int, campaign: str, files: Mapping[str, bytes]) -> None:
        self._program = program
        self._threads = threads
        self._campaign = campaign
        self._files = files

    def __call__(self, first: int, end: int) -> dict[str, bytes]:
        with tempfile.TemporaryDirectory(prefix="rotortwin-shards-") as work:
            root, out = Path(work, "files"), Path(work, "out")
            places = set()
            for name, content in self._files.items():
                place = _below(root, name)
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content)
                # A name is looked up in `vehicles/`, `blades/` … of such a folder.
                places.add(str(place.parent.parent))
            words = ["campaign", str(_below(root, self._campaign)), "--out", str(out)]
            words += ["--shards", f"{first}..{end}", "--jobs", str(self._threads), "--json"]
            _say(self._program, words, ROTORTWIN_CONFIG=os.pathsep.join(sorted(places)))
            files = [out / "campaign.json", *sorted((out / "shards").glob("*.parquet"))]
            return {str(file.relative_to(out)): file.read_bytes() for file in files}


def _below(root: Path, name: str) -> Path:
    """Where a file of another machine is placed: files that name each other do so relative to where they are."""
    return root / os.path.normpath(name).lstrip("/")


#: Yields the tasks' results in order of completion.
_Submitter = Callable[[_Task, list[tuple[int, int]]], Iterator[Mapping[str, bytes]]]


def _submitter(
    executor: Any, threads: int, retries: int, resources: Mapping[str, float] | None, memory: int | None
) -> _Submitter:
    if executor == "ray" or getattr(executor, "__name__", None) == "ray":
        return lambda task, ranges: _by_ray(task, ranges, threads, retries, resources, memory)
    if memory is not None:
        raise CampaignFailed(f"memory: expected Ray, {type(executor).__name__} has no request of memory")
    if hasattr(executor, "get_executor"):
        executor = executor.get_executor(pure=False, retries=retries, **({"resources": dict(resources)} if resources else {}))
    elif resources:
        raise CampaignFailed(f"resources: expected Ray or Dask, {type(executor).__name__} knows none")
    if not hasattr(executor, "submit"):
        kind = type(executor).__name__
        raise CampaignFailed(f"executor: expected None, 'ray', a client of Dask or an executor of concurrent.futures, got {kind}")
    return lambda task, ranges: _by_futures(executor, task, ranges)


def _by_futures(executor: Any, task: _Task, ranges: list[tuple[int, int]]) -> Iterator[Mapping[str, bytes]]:
    waiting, running = iter(ranges), set()
    try:
        while True:
            for first, end in waiting:
                running.add(executor.submit(task, first, end))
                if len(running) >= _AHEAD:
                    break
            if not running:
                return
            done, running = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
            for future in done:
                yield future.result()
    finally:
        for future in running:
            future.cancel()


def _by_ray(
    task: _Task, ranges: list[tuple[int, int]], threads: int, retries: int, resources: Mapping[str, float] | None, memory: int | None
) -> Iterator[Mapping[str, bytes]]:
    try:
        import ray
    except ImportError as error:
        raise CampaignFailed("executor='ray' needs Ray: pip install ray") from error
    if not ray.is_initialized():
        ray.init()
    # Ray recovers from deaths of nodes and processes; what the program itself refuses is refused everywhere.
    options: dict[str, Any] = {} if memory is None else {"memory": memory}
    fly = ray.remote(num_cpus=threads, max_retries=retries, resources=dict(resources or {}), **options)(_fly)
    shared = ray.put(task)
    waiting, running = iter(ranges), []
    try:
        while True:
            for first, end in waiting:
                running.append(fly.remote(shared, first, end))
                if len(running) >= _AHEAD:
                    break
            if not running:
                return
            done, running = ray.wait(running, num_returns=1)
            for reference in done:
                try:
                    yield ray.get(reference)
                except ray.exceptions.RayTaskError as error:
                    raise _cause(error) from error
                except ray.exceptions.RayError as error:
                    raise CampaignFailed(f"Ray gave a task up after {retries} retries: {str(error).splitlines()[0]}") from error
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


def _fly(task: _Task, first: int, end: int) -> dict[str, bytes]:
    return task(first, end)


def _cause(error: Any) -> Exception:
    cause = getattr(error, "cause", None)
    return cause if isinstance(cause, CampaignFailed) else CampaignFailed(f"a task failed: {str(error).splitlines()[-1]}")


def _program(named: str | None) -> str:
    """The program of this machine."""
    beside = Path(sys.executable).with_name("rotortwin")
    found = named or os.environ.get(_PROGRAM) or (str(beside) if beside.is_file() else shutil.which("rotortwin"))
    if found is None:
        raise CampaignFailed(
            "there is no program rotortwin beside this Python or on the search path; expected the wheel of the platform (`cargo xtask dist`"
            f" makes it), or {_PROGRAM} that names it"
        )
    return found


def _say(program: str | None, words: list[str], **environment: str) -> str:
    """The output of a command; it is killed when this process ends."""
    command = [_program(program), "--end-with-stdin", *words]
    try:
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | environment
        ) as process:
            # The standard input stays open: the program takes its closing for the death of this process.
            assert process.stdout is not None and process.stderr is not None
            with concurrent.futures.ThreadPoolExecutor(1) as reader:
                complaints = reader.submit(process.stderr.read)
                said = process.stdout.read()
                complained = complaints.result().strip().splitlines()
    except OSError as error:
        raise CampaignFailed(f"{command[0]}: cannot be started: {error}") from error
    if process.returncode != 0:
        why = complained[-1].removeprefix("rotortwin: ") if complained else f"it ended with {process.returncode} and said nothing"
        raise CampaignFailed(why)
    return said


def _write_whole(path: Path, content: bytes) -> None:
    part = path.with_suffix(".part")
    part.write_bytes(content)
    part.replace(path)
