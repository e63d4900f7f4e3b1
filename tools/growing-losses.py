#!/usr/bin/env python3
"""Sizes of losses that grow, by a run's sequential detector and by its second look (docs/detector.md).

usage: tools/growing-losses.py [SEED [FLIGHTS]]     (71205, 24 of each kind; ROTORTWIN names another program)

Each flight: `hover` or `windy-hover`, 60 s; from 20 to 30 s on a rotor loses 3 to 15 % of its thrust, at once or over 1, 5 or 15 s; all drawn. Compared is
what each says of the loss at the end with what it is then.
"""

import json
import os
import pathlib
import random
import statistics
import subprocess
import sys
import tempfile

KINDS = {"step": None, "grows for 1 s": 1.0, "grows for 5 s": 5.0, "grows for 15 s": 15.0}
PROGRAM = os.environ.get("ROTORTWIN", str(pathlib.Path(__file__).parent.parent / "target/release/rotortwin"))


def compared(severity: dict, rotor: int, share: float) -> tuple[str, float | None]:
    """Whether the interval of the rotor, if it alone is named, holds the share that it has lost; the relative error."""
    losses = severity["losses"]
    if [loss["rotor"] for loss in losses] != [rotor]:
        return "no single rotor", None
    low, high = losses[0]["interval_share"]
    return ("inside" if low <= share <= high else "outside"), losses[0]["share"] / share - 1.0


def flown(draw: random.Random, ramp_s: float | None, folder: pathlib.Path) -> tuple[list[tuple[str, float | None]], list[int]]:
    """Of the sequential detector and of the second look: the size compared, and false alarms before the onset."""
    rotor, seed = draw.randint(1, 6), draw.randint(1000, 99999)
    onset_s, percent = draw.uniform(20, 30), draw.uniform(3, 15)
    scenario = draw.choice(["hover", "windy-hover"])
    ramp = "" if ramp_s is None else f", ramp_s={ramp_s}"
    fault = f"fault=[{{time_s={onset_s:.3f}, rotor={rotor}, thrust_loss_percent={percent:.2f}{ramp}}}]"
    command = [PROGRAM, "fly", scenario, "--seed", str(seed), "--link", "in-process", "--out", str(folder)]
    subprocess.run([*command, "--set", "duration_s=60", "--set", fault], check=True, capture_output=True)
    summary = json.loads((folder / "summary.json").read_text())
    second = next(one for one in summary["own_detectors"] if one["name"] == "Second look")
    said = [summary["intervals"][-1]["severity"], second["statements"][-1]["severity"]]
    alarms = [summary["intervals"][0]["scores"]["sequential"], second["scores"][0]]
    return [compared(one, rotor, percent / 100) for one in said], [one["false_alarm_events"] for one in alarms]


def main() -> None:
    words = [int(word) for word in sys.argv[1:]]
    seed, flights = words + [71205, 24][len(words) :]
    draw = random.Random(seed)
    for kind, ramp_s in KINDS.items():
        results = []
        for _ in range(flights):
            with tempfile.TemporaryDirectory() as folder:
                results.append(flown(draw, ramp_s, pathlib.Path(folder) / "run"))
        for place, name in enumerate(["sequential detector", "second look"]):
            answers = [sizes[place] for sizes, _ in results]
            counts = {word: sum(answer == word for answer, _ in answers) for word in ("inside", "outside", "no single rotor")}
            errors = [abs(error) for _, error in answers if error is not None] or [float("nan")]
            alarms = sum(alarms[place] for _, alarms in results)
            print(
                f"{kind}, {name}: {', '.join(f'{word} {count}' for word, count in counts.items())} of {flights}; "
                f"error {100 * statistics.median(errors):.1f} % in the median, {100 * max(errors):.1f} % at worst; {alarms} false alarms before",
                flush=True,
            )


main()
