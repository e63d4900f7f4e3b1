"""The blocking client is what `generate_sync.py` makes of the one for asyncio."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from generate_sync import MODULES, SOURCES, generate  # noqa: E402


def test_the_blocking_client_is_made_from_the_other(tmp_path: Path) -> None:
    generate(tmp_path)
    for made, _ in MODULES.values():
        assert (tmp_path / made).read_text() == (SOURCES / made).read_text(), f"{made}: run `python generate_sync.py`"
