"""SQL over results: every Parquet file below a folder or an address of an object store, by DuckDB, in bounded memory.

    import rotortwin

    table = rotortwin.query("SELECT folder, max(true_roll_rad) AS roll FROM telemetry GROUP BY folder", "runs")
    worst = rotortwin.query("SELECT * FROM campaign ORDER BY sequential_isolated_after_s DESC LIMIT 10", "out")
    there = rotortwin.query("SELECT count(*) FROM shards", "s3://bench/night-17")

Files of one name are one table of that name (`telemetry.parquet` of all runs: `telemetry`), with a column `folder`: the folder of each
row's file. Files that are only numbered (`shards/000001.parquet`) are named after their folder. Columns that only some files have are NULL
in the rows of the others; of the files of one folder of an object store the columns are those of the first. The SQL is DuckDB's
(https://duckdb.org/docs/sql/introduction). `query` runs it in this process, with the rights of the caller. `main` is what the command
`rotortwin query` and the server run in a process of their own: one SELECT, which reaches the files of these tables and nothing else.

This module uses nothing of its package: the program carries a copy of it.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import shutil
import sys
import tempfile
import threading
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow

#: DuckDB's default memory limit; what does not fit goes to a temporary folder.
MEMORY = "512MB"

#: A folder, an address `s3://BUCKET/PREFIX`, several of them, or several by the name that their rows have in the column `folder`.
Sources = str | PathLike[str] | Sequence[str | PathLike[str]] | Mapping[str, str | PathLike[str]]

#: Exit code of `main`: this Python has no DuckDB, or one that is too old.
NO_DUCKDB = 4
#: The first DuckDB with a list of files that it may read.
_OLDEST = (1, 2)
#: Time-out for an object store, s.
_PATIENCE_S = 20.0
#: Rows fetched from DuckDB at once.
_BATCH = 256


def query(sql: str, folder: Sources = ".", *, memory: str = MEMORY, threads: int | None = None) -> pyarrow.Table:
    """The answer to `sql` about all results below `folder`, as an Arrow table.

    memory: what the query may take besides its answer, such as `"512MB"`. threads: by default one for each processor.
    Credentials of an object store: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT`.
    Needs `pip install 'rotortwin[query]'`.
    """
    try:
        import duckdb
    except ImportError as error:
        raise ImportError("SQL over results needs DuckDB: pip install 'rotortwin[query]'") from error
    with tempfile.TemporaryDirectory(prefix="rotortwin-query-") as spill, duckdb.connect() as connection:
        _configure(connection, memory, threads, spill)
        _add_tables(connection, _named(folder))
        answer = connection.sql(sql)
        if answer is None:
            raise ValueError("the statement gives no rows; expected a SELECT")
        return answer.to_arrow_table()


async def query_async(sql: str, folder: Sources = ".", *, memory: str = MEMORY) -> pyarrow.Table:
    """`query` in a thread of its own."""
    return await asyncio.to_thread(query, sql, folder, memory=memory)


def _configure(connection: Any, memory: str, threads: int | None, spill: str, most_spill: str | None = None) -> None:
    settings: dict[str, Any] = {"memory_limit": memory, "temp_directory": spill}
    # A slow query would draw a progress bar into the caller's output.
    settings |= {"preserve_insertion_order": False, "enable_progress_bar": False}
    if most_spill is not None:
        settings["max_temp_directory_size"] = most_spill
    if threads is not None:
        settings["threads"] = threads
    for name, value in settings.items():
        connection.execute(f"SET {name} = {_text(str(value))}")


def _named(sources: Sources) -> list[tuple[str, str]]:
    """Places, each with what the column `folder` begins with."""
    if isinstance(sources, Mapping):
        return [(name, str(place)) for name, place in sources.items()]
    if isinstance(sources, (str, PathLike)):
        return [("", str(sources))]
    places = [str(place) for place in sources]
    return [("", places[0])] if len(places) == 1 else [(place.rstrip("/"), place) for place in places]


def _add_tables(connection: Any, sources: Iterable[tuple[str, str]]) -> list[str]:
    """Makes a view for each table; the local files that they read."""
    parts: dict[str, list[str]] = defaultdict(list)
    local: list[str] = []
    for label, place in sources:
        if place.startswith("s3://"):
            found = _selects_of_bucket(connection, label, place)
        else:
            found, files = _selects_of_folder(label, Path(place))
            local += files
        if not found:
            raise FileNotFoundError(f"{place}: no Parquet files there; expected a folder of runs, campaigns or benches")
        for name, selects in found.items():
            parts[name] += selects
    for name, selects in parts.items():
        connection.execute(f'CREATE VIEW "{name}" AS {" UNION ALL BY NAME ".join(selects)}')
    return local


def _selects_of_folder(label: str, root: Path) -> tuple[dict[str, list[str]], list[str]]:
    """The statements that read the Parquet files below a folder, by the name of their table, and the files."""
    tables: dict[str, list[str]] = defaultdict(list)
    for file in _files_below(root):
        tables[_table_of(file.stem, file.parent.name)].append(str(file))
    selects = {}
    for name, files in tables.items():
        # The root and the separator, then the folder, then the separator and the file.
        start = len(f"{root}/") + 1
        source = f"read_parquet([{', '.join(map(_text, files))}], union_by_name = true, filename = 'file of this row')"
        folder = f"regexp_replace(substr(\"file of this row\", {start}), '/?[^/]*$', '')"
        if label:
            folder = f"rtrim({_text(label + '/')} || {folder}, '/')"
        selects[name] = [f'SELECT {folder} AS folder, * EXCLUDE ("file of this row") FROM {source}']
    return selects, [file for files in tables.values() for file in files]


def _files_below(root: Path) -> list[Path]:
    """Parquet files in order. Links below the root are not followed: they lead anywhere."""
    found = []
    for folder, _folders, files in os.walk(root, followlinks=False):
        paths = (Path(folder, name) for name in files if name.endswith(".parquet"))
        found += [path for path in paths if path.is_file() and not path.is_symlink()]
    return sorted(found)


def _selects_of_bucket(connection: Any, label: str, address: str) -> dict[str, list[str]]:
    """As `_selects_of_folder`, of an object store: read where the files are, only the columns and row groups that are asked for."""
    try:
        import pyarrow
        from pyarrow import dataset, fs
    except ImportError as error:
        raise ImportError("SQL over an object store needs PyArrow: pip install pyarrow") from error
    options: dict[str, Any] = {"connect_timeout": _PATIENCE_S, "request_timeout": _PATIENCE_S}
    endpoint = os.environ.get("AWS_ENDPOINT") or os.environ.get("AWS_ENDPOINT_URL")
    if endpoint:
        scheme, _, host = endpoint.rpartition("://")
        options |= {"endpoint_override": host.rstrip("/"), "scheme": scheme or "https"}
    region = os.environ.get("AWS_REGION") or os.environ.get("AWS_DEFAULT_REGION")
    store = fs.S3FileSystem(region=region, **options)
    root = address.removeprefix("s3://").strip("/")
    try:
        entries = store.get_file_info(fs.FileSelector(root, recursive=True, allow_not_found=True))
    except (OSError, pyarrow.ArrowException) as error:
        raise OSError(f"{address}: cannot be listed: {str(error).splitlines()[0]}") from error
    folders: dict[tuple[str, str], list[str]] = defaultdict(list)
    for entry in sorted(entries, key=lambda entry: entry.path):
        if entry.type == fs.FileType.File and entry.path.endswith(".parquet"):
            folder, _, file = entry.path.rpartition("/")
            table = _table_of(file.removesuffix(".parquet"), folder.rpartition("/")[2])
            folders[table, folder.removeprefix(root).strip("/")].append(entry.path)
    selects: dict[str, list[str]] = defaultdict(list)
    for (table, folder), files in folders.items():
        # A view refers to registered data by name only.
        name = f"files {len(selects)} of {address} {folder} {table}".replace('"', "'")
        connection.register(name, dataset.dataset(files, filesystem=store, format="parquet"))
        shown = "/".join(part for part in (label, folder) if part)
        selects[table].append(f'SELECT {_text(shown)} AS folder, * FROM "{name}"')
    return selects


def _table_of(stem: str, folder: str) -> str:
    names = [name for name in (stem, folder) if re.fullmatch(r"[A-Za-z_]\w*", name)]
    return names[0] if names else "files"


def _text(value: str) -> str:
    """A text of SQL."""
    return "'" + value.replace("'", "''") + "'"


class _Refusal(Exception):
    """Bad input, in one sentence."""


def main() -> int:
    """Answers the request on the standard input: `{"columns": [{"name", "type"}]}`, a line for each row, then `{"rows", "more"}`.

    The request is one line of JSON: `sql`, `sources` ([label, place] each), `memory`, `threads`, `spill`, `spill_most`, and `rows` and
    `bytes`, after which there is no more. Ends when the standard input does.
    """
    request = json.loads(sys.stdin.readline())
    if not _has_duckdb():
        return NO_DUCKDB
    threading.Thread(target=_end_with_stdin, args=(request["spill"],), daemon=True).start()
    try:
        _answer(request)
    except (_Refusal, FileNotFoundError) as error:
        print(error, file=sys.stderr)
        return 2
    except (ImportError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    sys.stdout.flush()
    return 0


def _has_duckdb() -> bool:
    """Whether there is a DuckDB that can be kept to the files of a query."""
    try:
        import duckdb
    except ImportError:
        return False
    return tuple(int(part) for part in duckdb.__version__.split(".")[:2]) >= _OLDEST


def _end_with_stdin(spill: str) -> None:
    sys.stdin.read()
    # The process that created the folder may have been killed.
    shutil.rmtree(spill, ignore_errors=True)
    os._exit(1)


def _answer(request: Mapping[str, Any]) -> None:
    import duckdb

    with duckdb.connect() as connection:
        _configure(connection, request["memory"], request["threads"], request["spill"], request["spill_most"])
        sql = request["sql"]
        try:
            files = _add_tables(connection, request["sources"])
            _lock(connection, files)
            # After the lock: reading some statements (IMPORT DATABASE) reads files.
            _check_is_a_question(connection, sql)
            cursor = connection.execute(sql)
            names = _told_apart([column[0] for column in cursor.description])
            kinds = [str(column[1]) for column in cursor.description]
            print(json.dumps({"columns": [{"name": name, "type": kind} for name, kind in zip(names, kinds, strict=True)]}))
            _print_rows(cursor, request["rows"], request["bytes"])
        except duckdb.Error as error:
            # The first line is the message; those after it may repeat the statement.
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            raise _Refusal(f"the SQL cannot be answered: {' '.join(lines[:2])[:1000]}") from error


def _check_is_a_question(connection: Any, sql: str) -> None:
    import duckdb

    try:
        statements = connection.extract_statements(sql)
    except duckdb.Error as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise _Refusal(f"not SQL: {' '.join(lines[:2])[:1000]}") from error
    # It writes nothing, and no second statement follows.
    if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
        kinds = ", ".join(statement.type.name for statement in statements) or "nothing"
        raise _Refusal(f"expected one SELECT (or FROM, WITH, DESCRIBE, SUMMARIZE), got {kinds}")


def _lock(connection: Any, files: Sequence[str]) -> None:
    """Nothing but these files from here on: no other file, no network, no extension, no variable of Python."""
    for name in ("autoinstall_known_extensions", "autoload_known_extensions", "python_enable_replacements"):
        connection.execute(f"SET {name} = false")
    connection.execute(f"SET allowed_paths = [{', '.join(map(_text, files))}]")
    connection.execute("SET enable_external_access = false")
    connection.execute("SET lock_configuration = true")


def _told_apart(names: Sequence[str]) -> list[str]:
    """Two columns of one name would be one in an object of JSON."""
    seen: dict[str, int] = defaultdict(int)
    apart = []
    for name in names:
        seen[name] += 1
        apart.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    return apart


def _print_rows(cursor: Any, most: int | None, most_bytes: int | None) -> None:
    rows, size = 0, 0
    while batch := cursor.fetchmany(_BATCH):
        for row in batch:
            line = json.dumps([_as_json(value) for value in row], ensure_ascii=False)
            size += len(line.encode())
            if most_bytes is not None and size > most_bytes and rows == 0:
                raise _Refusal(f"the first row alone has more than {most_bytes >> 20} MiB; expected smaller values")
            if (most is not None and rows == most) or (most_bytes is not None and size > most_bytes):
                print(json.dumps({"rows": rows, "more": True}))
                return
            print(line)
            rows += 1
    print(json.dumps({"rows": rows, "more": False}))


def _as_json(value: Any) -> Any:
    """What JSON has no word for is a text; what is not a number is null."""
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, (list, tuple)):
        return [_as_json(part) for part in value]
    if isinstance(value, Mapping):
        return {str(key): _as_json(part) for key, part in value.items()}
    if isinstance(value, (bytes, bytearray, memoryview)):
        return bytes(value).hex()
    return str(value)
