"""SQL over results; in folders of files that a run, a campaign and a stranger leave."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import rotortwin

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
pytest.importorskip("duckdb", reason="SQL over results needs DuckDB")


def write(path: Path, **columns: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path)


def test_val_files_of_one_name_are_one_table(tmp_path: Path) -> None:
    root = tmp_path / "it's a [folder]"
    write(root / "a/telemetry.parquet", time_s=[0.0, 1.0], roll_rad=[0.1, 0.3])
    write(root / "deep/b/telemetry.parquet", time_s=[0.0], roll_rad=[0.2], only_b=[7])
    write(root / "campaign.parquet", flight=[1, 2, 3])
    write(root / "shards/000001.parquet", flight=[1])
    write(root / "shards/000002.parquet", flight=[2, 3])
    table = rotortwin.query("SELECT folder, max(roll_rad) AS roll, max(only_b) AS b FROM telemetry GROUP BY folder ORDER BY folder", root)
    assert table.to_pylist() == [{"folder": "a", "roll": 0.3, "b": None}, {"folder": "deep/b", "roll": 0.2, "b": 7}]
    both = rotortwin.query("SELECT (SELECT sum(flight) FROM campaign) AS whole, sum(flight) AS parts FROM shards", str(root))
    assert both.to_pylist() == [{"whole": 6, "parts": 6}]
    assert rotortwin.query("SELECT DISTINCT folder FROM campaign", root).to_pylist() == [{"folder": ""}]


def test_val_what_cannot_be_asked_is_said(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no Parquet files there; expected a folder of runs"):
        rotortwin.query("SELECT 1", tmp_path)
    write(tmp_path / "telemetry.parquet", time_s=[0.0])
    with pytest.raises(Exception, match="nothing"):
        rotortwin.query("SELECT * FROM nothing", tmp_path)


#: Runs a query in a separate process, to measure memory: peak of the process before and after, MiB, and the time, s.
ASK = """
import json, resource, sys, time
import duckdb, pyarrow
import rotortwin
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
before, begun = peak(), time.monotonic()
table = rotortwin.query(sys.argv[1], sys.argv[2], memory="256MB")
print(json.dumps([before, peak(), time.monotonic() - begun, table.to_pylist()]))
"""


def test_val_a_million_flights_in_bounded_memory(tmp_path: Path) -> None:
    count, files = 1_000_000, 50
    for number in range(files):
        rows = range(number * count // files, (number + 1) * count // files)
        write(
            tmp_path / f"part-{number}/campaign.parquet",
            flight=list(rows),
            rotor=[1 + row % 6 for row in rows],
            delay_s=[0.01 * (row % 500) for row in rows],
            # Long enough not to fit into the query's memory at once.
            hash=[f"{row * 2654435761 % 2**61:032x}" * 4 for row in rows],
            **{f"number_{column}": [float(row ^ column) for row in rows] for column in range(16)},
        )
    sql = """SELECT rotor, count(*) AS flights, avg(delay_s) AS delay_s, count(DISTINCT hash) AS hashes, max(number_3) AS most
             FROM campaign GROUP BY rotor ORDER BY rotor"""
    asked = subprocess.run([sys.executable, "-c", ASK, sql, str(tmp_path)], capture_output=True, text=True, check=False, timeout=300)
    assert asked.returncode == 0, asked.stderr
    before, after, time_s, rows_found = json.loads(asked.stdout)
    print(f"{count} rows: {time_s:.2f} s, {before:.0f} MiB before, {after:.0f} MiB at most")
    assert sum(row["flights"] for row in rows_found) == count
    assert sum(row["hashes"] for row in rows_found) == count
    for row in rows_found:
        flights = range(row["rotor"] - 1, count, 6)
        assert row["flights"] == len(flights)
        assert row["most"] == max(float(flight ^ 3) for flight in flights)
        assert row["delay_s"] == pytest.approx(sum(0.01 * (flight % 500) for flight in flights) / len(flights))
    assert after < 1024, f"{after} MiB"
