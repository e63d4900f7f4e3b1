"""SQL over results: every Parquet file below a folder, by DuckDB, in bounded memory.

    import rotortwin

    table = rotortwin.query("SELECT folder, max(true_roll_rad) AS roll FROM telemetry GROUP BY folder", "runs")
    worst = rotortwin.query("SELECT * FROM campaign ORDER BY sequential_delay_s DESC LIMIT 10", "out")

Files of one name are one table of that name (`telemetry.parquet` of all runs: `telemetry`), with a column `folder`: where each row's file
lies. Files that are only numbered (`shards/000001.parquet`) are named after their folder. Columns that only some files have are NULL in the
rows of the others. The SQL is DuckDB's (https://duckdb.org/docs/sql/introduction), run in this process as whoever calls it.
"""

from __future__ import annotations

import re
import tempfile
from collections import defaultdict
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow

#: What DuckDB may take where nothing else is said; what does not fit goes to a temporary folder.
MEMORY = "512MB"


def query(
    sql: str, folder: str | PathLike[str] = ".", *, memory: str = MEMORY, threads: int | None = None
) -> pyarrow.Table:
    """The answer to `sql` about all results below `folder`, as an Arrow table.

    memory: what the query may take beside its answer, such as `"512MB"`. threads: by default one for each processor.
    Needs `pip install 'rotortwin[query]'`.
    """
    try:
        import duckdb
    except ImportError as error:
        raise ImportError("SQL over results needs DuckDB: pip install 'rotortwin[query]'") from error
    root = Path(folder)
    tables = _tables(root)
    if not tables:
        raise FileNotFoundError(f"{root}: no Parquet files there; expected a folder of runs, campaigns or benches")
    with tempfile.TemporaryDirectory(prefix="rotortwin-query-") as spill, duckdb.connect() as connection:
        settings: dict[str, Any] = {"memory_limit": memory, "temp_directory": spill}
        # What is slow would draw a bar into the output of whoever asks.
        settings |= {"preserve_insertion_order": False, "enable_progress_bar": False}
        if threads is not None:
            settings["threads"] = threads
        for name, value in settings.items():
            connection.execute(f"SET {name} = {_text(str(value))}")
        for name, files in tables.items():
            # The root and the separator, then the folder, then the separator and the file.
            start = len(f"{root}/") + 1
            source = f"read_parquet([{', '.join(_text(str(file)) for file in files)}], union_by_name = true, filename = 'file of this row')"
            folder_of = f"regexp_replace(substr(\"file of this row\", {start}), '/?[^/]*$', '')"
            columns = f"{folder_of} AS folder, * EXCLUDE (\"file of this row\")"
            connection.execute(f'CREATE VIEW "{name}" AS SELECT {columns} FROM {source}')
        answer = connection.sql(sql)
        if answer is None:
            raise ValueError("the statement gives no rows; expected a SELECT")
        return answer.to_arrow_table()


def _tables(root: Path) -> dict[str, list[Path]]:
    """Parquet files by the name of their table."""
    tables: dict[str, list[Path]] = defaultdict(list)
    for file in sorted(root.rglob("*.parquet")):
        names = [name for name in (file.stem, file.parent.name) if re.fullmatch(r"[A-Za-z_]\w*", name)]
        tables[names[0] if names else "files"].append(file)
    return tables


def _text(value: str) -> str:
    """A text of SQL."""
    return "'" + value.replace("'", "''") + "'"
