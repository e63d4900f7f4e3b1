#!/usr/bin/env python3
"""Real logs as a stranger's: python3 tools/real-logs.py LOG:MASS_KG:ARM_M [LOG:MASS_KG:ARM_M …]

Prints two tables in Markdown. First, R² on data that no fit has seen, class default and calibrated, as `rotortwin vehicle from-log --held-out`
says it: each half of the flight by what the other half gave. Second, what effects add: a vehicle from the first half of the time in the air,
`rotortwin improve` on that half, and the errors on the second half, which neither has seen, before and after.
Needs target/release/rotortwin (or ROTORTWIN) and nothing else.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

PROGRAM = os.environ.get("ROTORTWIN", str(Path(__file__).resolve().parent.parent / "target/release/rotortwin"))


def run(*arguments: str) -> tuple[dict | None, str]:
    """The JSON that a command prints, or the sentence with which it refuses."""
    done = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, check=False)
    try:
        return json.loads(done.stdout), ""
    except json.JSONDecodeError:
        lines = (done.stderr or done.stdout).strip().splitlines()
        return None, lines[-1] if lines else "no answer"


def number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def calibrated(log: str, mass: str, arm: str) -> dict | None:
    """Rows of the first table; the identification, or None."""
    name = Path(log).name
    found, refusal = run("vehicle", "from-log", log, "--mass", mass, "--arm", arm, "--held-out", "--json")
    if found is None:
        found, again = run("vehicle", "from-log", log, "--mass", mass, "--arm", arm, "--json")
        print(f"| `{name}` | {(again or refusal).replace('|', '/')} | | | |")
        return found
    for score in found["held_out"][0]["scores"]:
        band = f"{score['band']['low_hz']:g} to {score['band']['high_hz']:g} Hz"
        print(f"| `{name}` | {score['channel']} | {band} | {number(score['class_default'])} | {number(score['calibrated'])} |")
    roll, pitch = found["held_out"][0]["gain_ratio"]
    print(f"| `{name}` | gains, second half over first: roll, pitch | | | {number(roll)}, {number(pitch)} |")
    return found


def with_effects(log: str, mass: str, arm: str, parts: list[dict]) -> None:
    """A row of the second table."""
    name = Path(log).name
    first, last = parts[0]["start_s"], parts[-1]["end_s"]
    flown = sum(part["end_s"] - part["start_s"] for part in parts)
    # The middle of the time in the air, not of the log.
    middle, left = first, 0.5 * flown
    for part in parts:
        length = part["end_s"] - part["start_s"]
        middle = part["start_s"] + min(left, length)
        if left <= length:
            break
        left -= length
    early, late = f"{log}@{first:.2f}:{middle:.2f}", f"{log}@{middle:.2f}:{last:.2f}"
    with tempfile.TemporaryDirectory() as folder:
        own = f"{folder}/own.toml"
        # Seconds at the ends of a flight are cut by the identification itself, so it gets what is around the part as well.
        _, refusal = run("vehicle", "from-log", f"{log}@{max(first - 3.0, 0.0):.2f}:{middle + 3.0:.2f}", "--mass", mass, "--arm", arm, "--out", own, "--json")
        if not Path(own).exists():
            print(f"| `{name}` | {refusal.replace('|', '/')} | |")
            return
        improved, refusal = run("improve", early, "--held-out", late, "--model", own, "--models", f"{folder}/models", "--yes", "--json")
        if improved is None:
            print(f"| `{name}` | {refusal.replace('|', '/')} | |")
            return
        rows = [row for row in improved["rows"] if not row["oracle"]]
        added = ", ".join(row["added"] for row in rows if row["added"]) or "nothing"
        errors = []
        for quantity in ("force", "torque", "voltage"):
            of = [next((e for on in row["logs"] if on["held_out"] for e in on["errors"] if e["quantity"] == quantity), None) for row in rows]
            if of[0] and of[-1]:
                errors.append(f"{quantity} {of[0]['error']:.3g} → {of[-1]['error']:.3g} {of[0]['unit']} (noise {of[0]['noise']:.2g})")
        print(f"| `{name}` | {added}; {improved['end']} | {'; '.join(errors)} |", flush=True)
        print(f"{name}: {improved['reason']}", file=sys.stderr)


def main() -> None:
    logs = [argument.rsplit(":", 2) for argument in sys.argv[1:]]
    if not logs or any(len(log) != 3 for log in logs):
        sys.exit(__doc__)
    print("| log | channel | band | class default | calibrated |\n|---|---|---|---|---|")
    found = [(log, calibrated(*log)) for log in logs]
    print("\n| log | effects added on the first half; end | error on the second half |\n|---|---|---|")
    for log, identified in found:
        if identified and identified["identified"]["airborne"]:
            with_effects(*log, identified["identified"]["airborne"])


main()
