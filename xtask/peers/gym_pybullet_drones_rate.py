"""Closed-loop rate of gym-pybullet-drones on one core: prints one JSON object.

Argument: seconds of CPU time. Conditions are its own: Crazyflie, PyBullet at 240 Hz, PID at 48 Hz, hovering; no noise, no battery, no
fault detection.
"""

import json
import sys
import time

import numpy as np
from gym_pybullet_drones.control.DSLPIDControl import DSLPIDControl
from gym_pybullet_drones.envs.CtrlAviary import CtrlAviary
from gym_pybullet_drones.utils.enums import DroneModel, Physics

seconds = float(sys.argv[1])
env = CtrlAviary(
    drone_model=DroneModel.CF2X,
    num_drones=1,
    physics=Physics.PYB,
    pyb_freq=240,
    ctrl_freq=48,
    gui=False,
    initial_xyzs=np.array([[0.0, 0.0, 1.0]]),
)
control = DSLPIDControl(drone_model=DroneModel.CF2X)
action = np.zeros((1, 4))
observation, _ = env.reset()
steps, start = 0, time.process_time()
while time.process_time() - start < seconds:
    observation, _, _, _, _ = env.step(action)
    action[0], _, _ = control.computeControlFromState(
        control_timestep=1.0 / 48.0, state=observation[0], target_pos=np.array([0.0, 0.0, 1.0])
    )
    steps += 5
print(
    json.dumps(
        {
            "what": "gym-pybullet-drones",
            "computes": "quadrotor, PyBullet 240 Hz, PID 48 Hz; no noise, no FDI",
            "rate_hz": 240,
            "steps_per_cpu_s": steps / (time.process_time() - start),
        }
    ),
    flush=True,
)
