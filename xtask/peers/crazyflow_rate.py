"""Closed-loop rate of crazyflow on one core: prints one JSON object per number of worlds.

Argument: seconds of CPU time for each. Conditions are crazyflow's own defaults: 500 Hz, its integrator, its Mellinger controller
hovering at 1 m (state loop 100 Hz, attitude loop 500 Hz); no sensor noise, no battery, no fault detection. JAX compiles before the clock starts.
"""

import json
import sys
import time

import numpy as np
from crazyflow.control import Control
from crazyflow.sim import Sim

seconds = float(sys.argv[1])
for worlds in (1, 64, 1024):
    sim = Sim(n_worlds=worlds, n_drones=1, control=Control.state, freq=500, device="cpu")
    command = np.zeros((worlds, 1, 16), dtype=np.float32)
    command[..., 2] = 1.0
    command[..., 12] = 1.0  # w of the attitude
    chunk = 100

    def advance():
        sim.state_control(command)
        sim.step(chunk)
        sim.data.states.pos.block_until_ready()

    sim.reset()
    advance()
    advance()
    start, steps = time.process_time(), 0
    while time.process_time() - start < seconds:
        advance()
        steps += chunk * worlds
    if not 0.8 < float(np.mean(np.asarray(sim.data.states.pos)[..., 2])) < 1.2:
        sys.exit("the drones do not hover at 1 m: the task is not the one that is described")
    rate = steps / (time.process_time() - start)
    print(
        json.dumps(
            {
                "what": f"crazyflow, {worlds} world{'s' if worlds > 1 else ''}",
                "computes": f"quadrotor, 500 Hz, {sim.integrator}, {sim.dynamics}, Mellinger (100/500 Hz), f32; no noise, no FDI",
                "rate_hz": 500,
                "steps_per_cpu_s": rate,
            }
        ),
        flush=True,
    )
