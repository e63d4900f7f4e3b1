"""Campaigns whose shards an executor flies."""

from __future__ import annotations

import concurrent.futures
import shutil
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import rotortwin

from campaigns import assert_same, fly_here, write
from conftest import ROOT, program

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """A campaign of 7 shards, and its results from one machine."""
    folder = tmp_path_factory.mktemp("campaign")
    file = write(folder / "own", ROOT, flights=200, duration_s=6.0)
    fly_here(program(), file, folder / "one")
    yield file, folder / "one"


class Counting(concurrent.futures.ThreadPoolExecutor):
    """Counts what it is given."""

    def __init__(self) -> None:
        super().__init__(2)
        self.calls: list[tuple[Any, ...]] = []

    def submit(self, fn: Any, /, *args: Any, **more: Any) -> Any:
        self.calls.append(args)
        return super().submit(fn, *args, **more)


def test_val_any_executor_gives_the_bytes_of_one_machine(here: tuple[Path, Path], tmp_path: Path) -> None:
    file, one = here
    told: list[tuple[int, int]] = []
    with Counting() as threads:
        table = rotortwin.campaign(
            file, executor=threads, out=tmp_path / "threads", shards_per_task=2, program=program(), progress=lambda *at: told.append(at)
        )
    assert table.num_rows == 200
    assert sorted(threads.calls) == [(0, 2), (2, 4), (4, 6), (6, 7)]
    assert told[-1] == (7, 7)
    assert_same(one, tmp_path / "threads")
    with concurrent.futures.ProcessPoolExecutor(2) as processes:
        again = rotortwin.campaign(file, executor=processes, out=tmp_path / "processes", program=program())
    assert_same(one, tmp_path / "processes")
    # Not as a whole: NaN is not equal to anything.
    assert again["run_hash"].equals(table["run_hash"])
    assert rotortwin.campaign(file, program=program())["run_hash"].equals(table["run_hash"])


def test_val_what_is_there_is_not_flown_again(here: tuple[Path, Path], tmp_path: Path) -> None:
    file, one = here
    out = tmp_path / "out"

    class Dies(Counting):
        def submit(self, fn: Any, /, *args: Any, **more: Any) -> Any:
            if args[0] >= 3:
                fn = dies
            return super().submit(fn, *args, **more)

    with Dies() as dying, pytest.raises(OSError, match="the node is gone"):
        rotortwin.campaign(file, executor=dying, out=out, shards_per_task=1, program=program())
    before = {path.name for path in (out / "shards").glob("*.parquet")}
    assert before < {f"{number:06}.parquet" for number in range(3)}
    with Counting() as threads:
        rotortwin.campaign(file, executor=threads, out=out, shards_per_task=1, program=program())
    assert len(threads.calls) == 7 - len(before)
    assert_same(one, out)
    # Complete: nothing is flown.
    with Counting() as threads:
        rotortwin.campaign(file, executor=threads, out=out, program=program())
    assert threads.calls == []


class Task:
    """A function that a stand-in of Ray calls at once."""

    def __init__(self, function: Any) -> None:
        self._function = function

    def remote(self, *args: Any) -> Any:
        return self._function(*args)


def test_val_ray_is_asked_for_what_a_task_takes(here: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, one = here
    asked: list[dict[str, Any]] = []

    def remote(**options: Any) -> Any:
        asked.append(options)
        return Task

    ray: Any = types.SimpleNamespace(
        is_initialized=lambda: True,
        put=lambda value: value,
        remote=remote,
        wait=lambda running, num_returns: (running[:num_returns], running[num_returns:]),
        get=lambda value: value,
    )
    monkeypatch.setitem(sys.modules, "ray", ray)
    rotortwin.campaign(
        file, executor="ray", out=tmp_path / "ray", threads=2, retries=5, memory=400 << 20, resources={"bench": 0.5}, program=program()
    )
    assert asked == [{"num_cpus": 2, "max_retries": 5, "memory": 400 << 20, "resources": {"bench": 0.5}}]
    assert_same(one, tmp_path / "ray")


def dies(*_shards: int) -> None:
    raise OSError("the node is gone")


def test_val_what_cannot_be_flown_is_said_in_a_sentence(here: tuple[Path, Path], tmp_path: Path) -> None:
    file, one = here
    other = write(tmp_path / "own", ROOT, flights=64, duration_s=6.0)
    threads = concurrent.futures.ThreadPoolExecutor(1)
    with threads:
        shutil.copytree(one, tmp_path / "copy")
        with pytest.raises(rotortwin.CampaignFailed, match="holds flights of another campaign"):
            rotortwin.campaign(other, executor=threads, out=tmp_path / "copy", program=program())
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine/thesis.tex").write_text("x")
        with pytest.raises(rotortwin.CampaignFailed, match="not those of a campaign"):
            rotortwin.campaign(other, executor=threads, out=tmp_path / "mine", program=program())
        with pytest.raises(rotortwin.CampaignFailed, match="nobody"):
            rotortwin.campaign("nobody", executor=threads, program=program())
        with pytest.raises(rotortwin.CampaignFailed, match="nowhere: cannot be started"):
            rotortwin.campaign(other, executor=threads, program="nowhere")
        with pytest.raises(rotortwin.CampaignFailed, match="expected at least 1, got 0"):
            rotortwin.campaign(other, executor=threads, shards_per_task=0, program=program())
        with pytest.raises(rotortwin.CampaignFailed, match="ThreadPoolExecutor knows none"):
            rotortwin.campaign(other, executor=threads, resources={"gpu": 1.0}, program=program())
        with pytest.raises(rotortwin.CampaignFailed, match="ThreadPoolExecutor has no request of memory"):
            rotortwin.campaign(other, executor=threads, memory=1 << 30, program=program())
    with pytest.raises(rotortwin.CampaignFailed, match="at least 1, got 0"):
        rotortwin.campaign(other, executor="ray", memory=0, program=program())
    with pytest.raises(rotortwin.CampaignFailed, match="expected executor='ray'"):
        rotortwin.campaign(other, memory=1 << 30, program=program())
    with pytest.raises(rotortwin.CampaignFailed, match="expected None, 'ray'"):
        rotortwin.campaign(other, executor=7, program=program())
