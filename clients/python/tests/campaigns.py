"""A campaign of the tests, and what one machine makes of it."""

from __future__ import annotations

import subprocess
from pathlib import Path

#: Files that are byte-identical wherever the shards were flown.
RESULTS = ("campaign.parquet", "campaign.csv", "summary.json", "report.html")

FLIGHT = """
name = "executor-hover"
description = "a hover in which a rotor loses thrust"
vehicle = "../vehicles/own.toml"
duration_s = 8.0

[trajectory]
kind = "hover"
position_ned_m = [0.0, 0.0, -5.0]

[fdi]
calibration_start_s = 0.75
calibration_end_s = 4.75

[[fault]]
time_s = 5.0
rotor = 3
thrust_loss_percent = 20.0
"""

CAMPAIGN = """
name = "executor"
description = "flown by an executor"
scenario = "scenarios/hover.toml"
seed = 5
flights = {flights}

[set]
duration_s = {duration_s}

[[axis]]
name = "loss"
key = "fault[0].thrust_loss_percent"
log_uniform = [2.0, 30.0]
"""


def write(folder: Path, root: Path, *, flights: int, duration_s: float) -> Path:
    """The file of the campaign, with a vehicle and blades of its own."""
    for kind in ("scenarios", "vehicles", "blades"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    vehicle = (root / "config/vehicles/f550.toml").read_text().replace("t9545.toml", "own.toml")
    (folder / "vehicles/own.toml").write_text(vehicle)
    (folder / "blades/own.toml").write_text((root / "config/blades/t9545.toml").read_text())
    (folder / "scenarios/hover.toml").write_text(FLIGHT)
    file = folder / "campaign.toml"
    file.write_text(CAMPAIGN.format(flights=flights, duration_s=duration_s))
    return file


def fly_here(program: str, file: Path, out: Path) -> None:
    """The command on this machine."""
    subprocess.run([program, "campaign", str(file), "--out", str(out), "--json"], check=True, capture_output=True, timeout=300)


def assert_same(one: Path, other: Path) -> None:
    """The results are the same bytes."""
    for name in RESULTS:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
