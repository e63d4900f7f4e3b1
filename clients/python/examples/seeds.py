"""The same flight with several seeds: how long until the sequential detector names the damaged rotor?

    python examples/seeds.py [URL] [SCENARIO] [FLIGHTS]
"""

# %% Submit. All flights wait in the server's queue; this program may be killed and started again with the same result.
from __future__ import annotations

import sys

from rotortwin import Client

url, scenario, flights = (sys.argv[1:] + ["http://127.0.0.1:8400", "reference-flight", "4"][len(sys.argv) - 1 :])[:3]
client = Client(url)
seeds = range(1, int(flights) + 1)
submitted = [
    client.runs.submit(scenario, seed=seed, link="in-process", idempotency_key=f"seeds-{scenario}-{seed}") for seed in seeds
]

# %% Wait for all of them.
runs = [client.runs.wait(run.id, progress=True, check=True) for run in submitted]

# %% The detectors' verdicts in the intervals with a fault.
for run in runs:
    assert run.summary is not None
    for interval in run.summary["intervals"]:
        score = interval["scores"]["sequential"]
        if interval["expected_verdict"] != 0:
            delay = score["isolated_after_s"]
            found = "not found" if delay is None else f"found after {delay:.3f} s"
            print(f"seed {run.seed}: {interval['description']}: {found}")

# %% Telemetry as a data frame.
frame = client.runs.telemetry_frame(runs[0].id)
print(frame.describe().T.head())
