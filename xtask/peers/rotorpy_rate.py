"""Closed-loop rate of RotorPy on one core: prints one JSON object.

Argument: seconds of CPU time. Conditions are RotorPy's own: Crazyflie, SE3 controller, its integrator (scipy), IMU and motion capture
with noise, circular trajectory, at 400 Hz; no battery, no fault detection.
"""

import json
import sys
import time

from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.environments import Environment
from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

seconds = float(sys.argv[1])
steps, start = 0, time.process_time()
while time.process_time() - start < seconds:
    env = Environment(
        vehicle=Multirotor(quad_params),
        controller=SE3Control(quad_params),
        trajectory=ThreeDCircularTraj(),
        sim_rate=400,
    )
    flown = env.run(t_final=2.0, use_mocap=False, terminate=False, plot=False, verbose=False)
    steps += len(flown["time"]) - 1
print(
    json.dumps(
        {
            "what": "RotorPy",
            "computes": "quadrotor, 400 Hz, RK45 (scipy), SE3, IMU and motion capture with noise, f64; no FDI",
            "rate_hz": 400,
            "steps_per_cpu_s": steps / (time.process_time() - start),
        }
    ),
    flush=True,
)
