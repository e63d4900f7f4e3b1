"""Makes the blocking client from the one for asyncio, so that the same is not written by hand twice.

python generate_sync.py [FOLDER]: writes beside the sources, or into FOLDER. Needs `unasync`; `tests/test_generated.py` fails on a file that is
not what this makes.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import unasync  # type: ignore[import-untyped]

SOURCES = Path(__file__).parent / "src/rotortwin"
#: Source, generated module, and its first line.
MODULES = {
    "_aio_resource.py": ("_resource.py", "Jobs of one kind, with threads: the verbs that all of them have."),
    "aio.py": ("client.py", "The blocking client."),
    "aio_fdi.py": ("fdi.py", "The detectors as a service, over HTTP in chunks."),
    "aio_twin.py": ("twin.py", "Logs, comparisons, diagnoses, improvements, classifiers."),
}
#: In addition to `Async…`, `__aenter__` and the like, which `unasync` knows or which are found below.
NAMES = {
    "drive_async": "drive",
    "query_async": "query",
    "asyncio": "time",
    "aclose": "close",
    "aread": "read",
    "aiter_bytes": "iter_bytes",
} | {source.removesuffix(".py"): made.removesuffix(".py") for source, (made, _) in MODULES.items()}


def generate(folder: Path) -> None:
    """Writes the blocking modules into a folder."""
    texts = {name: (SOURCES / name).read_text(encoding="utf-8") for name in MODULES}
    names = NAMES | {name: name.removeprefix("Async") for text in texts.values() for name in re.findall(r"\bAsync[A-Z]\w*", text)}
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in texts.items():
            made, first = MODULES[name]
            source = Path(scratch) / "from" / name
            source.parent.mkdir(exist_ok=True)
            source.write_text(text.replace("`async with`", "`with`"), encoding="utf-8")
            rule = unasync.Rule("/from/", "/to/", additional_replacements=names)
            unasync.unasync_files([str(source)], [rule])
            _, _, rest = (Path(scratch) / "to" / name).read_text(encoding="utf-8").partition("\n")
            header = f'"""{first}"""\n\n# Made from {name} by generate_sync.py: change that file.\n'
            (folder / made).write_text(header + rest, encoding="utf-8")


if __name__ == "__main__":
    generate(Path(sys.argv[1]) if len(sys.argv) > 1 else SOURCES)
