#!/usr/bin/env python3
"""How often the 95 % intervals of `rotortwin diagnose` hold the truth when the vehicle file is slightly wrong.

    tools/coverage-of-intervals.py --binary target/release/rotortwin --seeds 1-5 --file-error 0.005 --out half.json
    tools/coverage-of-intervals.py --compare before.json after.json       two binaries, side by side
    tools/coverage-of-intervals.py --check                                the simulator alone, without a binary

Needs Python 3.10 and NumPy. Each case is a vehicle of its own, a flight of its own and one hidden effect, drawn from
the seed and the name of the effect. The log does not depend on the error of the vehicle file: the same flights are
diagnosed with an exact file (`--exact`) and with files that are off by any amount. They are kept in `--work` and flown
once.

The simulator was written from the documents (docs/, config/vehicles) and from mechanics, without reading the plant or
the twin. World: north-east-down (NED). Body: forward-right-down (FRD), origin in the centre of mass. SI, duty 0 to 1.

    v' = g e3 + R F/m         F = -e3 sum f_i - kappa (sum sqrt f_i) (a_x, a_y, 0) - k_t a + push,   a = R^T (v - wind)
    J w' = M - w x J w        M = sum (l_i - c) x (-f_i e3) + e3 sum s_i r f_i + twist
    tau f_i' = c_i (V - v0) (a1 p_i + a2 p_i^2) - f_i,   p_i = 100 duty_i           (Eq. 19 with a0 = a3 = 0)
    P = k_P sum f_i^1.5,   V = V_oc(charge) - R_in P/V,   charge' = -P/(3600 Q V)

kappa belongs to one vehicle, not to a hover: the file has k_d = kappa n sqrt(f_h) with the file's own hover thrust f_h.
Runge-Kutta 4 at 1000 or 1200 Hz, rows and control at 250 or 400 Hz. The controller sees the noisy values that are
logged. `push` (force) and `twist` (torque) are white, held for a row.

**Which number is the truth.** An effect corrects a constant of the file, so its true size is that of the real vehicle
relative to the FILE's value: mass m/m_file - 1, likewise inertias, lag, moment ratio, capacity, arm length and (for
`air-density`) the thrust of all rotors; drags, internal resistance and centre of mass are differences (real - file).
A flight shows ratios only, such as thrust over mass or thrust times arm over an inertia. That the thrust of the file is
off as well is no part of the truth of a mass: an honest interval is as wide as that makes the mass uncertain.
Exception, one rotor: s_i = c_i/mean(c_j, j != i) - 1, its thrust relative to that of the other rotors. Relative to the
file it would be (1 - loss) c/c_file - 1; but a level that all rotors have in common is an effect of its own
(`air-density`), the mass hides it, and "the thrust of one rotor is measured against the others" (docs/diagnose.md). The
second number is kept as `truth_of_file` in the results. Wind is absolute: no file has one.
Some sentences state a condition ("if thrust and arms are right"). The size that the flight shows if every other
constant of the file is right is kept as `truth_if` and counted in a row of its own: it separates intervals that leave
out the errors of other constants from values that are wrong altogether.
An effect that the simulator does not have has the true size 0.

**File errors.** With `--file-error E` each constant of the file is (1 + E n) times the real one, n normal: mass, three
inertias, thrust, moment ratio, lag, rotor drag, friction, arm, internal resistance, capacity and power coefficient. The
centre of mass is E times the arm off (1 sigma, each axis), times `--com-share`. Exact remain: gravity, the shape of the
thrust curve (v0, a1/a2), the open-circuit voltage, rotors that are alike (`--rotor-spread` makes them differ).

**How it is counted.** right: the answer names the effect (and the rotor) and stands by it; more may be named, then the
row has "and more". alternative: among the alternatives of what is named, or of "cannot tell". doubted: named, but the
verdict is "not, or not wholly, in the catalogue". calibrate: its constant is to be calibrated first. nothing: "agrees".
other: anything else. Without an effect "agrees" is right. z = (truth - estimate)/(half width/1.96), 1.0 r.m.s. if
intervals are as wide as errors are. An effect with two parameters has two rows and counts twice under "inside".

**Not modelled:** ground, walls and gusts; flapping, inflow, translational lift and every other effect of velocity on
thrust and moment; drag that acts off the centre of mass; gyroscopic and reaction torques of rotors; damping of body
rates; products of inertia; flex; delays, dead zone, saturation below full duty; lag of the speed instead of the thrust;
battery relaxation and temperature; biases, scales, misalignments, lever arms and latencies of sensors; an estimator
(noise of position, velocity and attitude is white); take-off, landing and lost rows; a current sensor.
"""

import argparse
import concurrent.futures
import copy
import json
import math
import pathlib
import subprocess
import time
import zlib
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

GRAVITY = 9.81  # m/s^2, NED: along +z
AIR = 1.225  # kg/m^3
# Open-circuit voltage of a LiPo cell at 0, 5 ... 100 % of charge, V: the chart of config/vehicles/f550.toml.
CELL = [3.27, 3.61, 3.69, 3.71, 3.73, 3.75, 3.77, 3.79, 3.80, 3.82, 3.84]
CELL += [3.85, 3.87, 3.91, 3.95, 3.98, 4.02, 4.08, 4.11, 4.15, 4.20]
ROTORS = 6  # places for rotors in the arrays of a batch; a quadrotor leaves two of them empty
AXES = ["roll", "pitch", "yaw"]
# Hidden effects, by their ids in the catalogue (`rotortwin effects`).
EFFECTS = {"none": None, "rotor-loss": "rotor-thrust-scale", "extra-mass": "mass", "centre-of-mass": "centre-of-mass"}
EFFECTS |= {"drag-more": "rotor-drag", "drag-less": "linear-friction", "capacity": "battery-capacity", "wind": "wind"}
EFFECTS |= {"torque-ratio": "moment-ratio", "inertia": "inertia-…", "lag": "motor-time-constant"}


# ---- vehicles, effects, files --------------------------------------------------------------------------------------


@dataclass
class Vehicle:
    """Constants of a real vehicle, or of the file that describes it. SI units, body FRD."""

    rotors: int
    mass: float  # kg
    inertia: np.ndarray  # kg m^2, principal, (3,)
    arm: float  # m, from the middle of the rotors to each of them
    com: np.ndarray  # m, centre of mass from the middle of the rotors, forward and right, (2,)
    ratio: float  # m, drag torque over thrust of a rotor
    lag: float  # s, first-order lag of the thrust
    curve: np.ndarray  # a1, a2 of Eq. 19, N/V per % and %^2
    dead_voltage: float  # V, v0 of Eq. 19
    share: np.ndarray  # thrust of each rotor over that of the curve, (rotors,)
    rotor_drag: float  # kappa, N s/m per sqrt N: of each rotor, across its axis
    friction: float  # k_t, kg/s, in all directions
    cells: int
    capacity: float  # Ah
    resistance: float  # ohm
    power: float  # k_P, W/N^1.5
    wind: np.ndarray  # m/s, where the air moves to, north and east (of the flight, in no file)

    def spins(self) -> np.ndarray:
        """+1 counter-clockwise seen from above (pushes the nose to the right), -1 clockwise."""
        return np.where(np.arange(self.rotors) % 2 == 0, 1.0, -1.0)

    def places(self) -> np.ndarray:
        """Rotors from the centre of mass, m, (rotors, 2): X layout, rotor 1 front right, then clockwise from above."""
        angles = math.pi / self.rotors + 2 * math.pi * np.arange(self.rotors) / self.rotors
        return self.arm * np.column_stack([np.cos(angles), np.sin(angles)]) - self.com

    def hover_thrust(self) -> float:
        return self.mass * GRAVITY / self.rotors

    def rotor_drag_in_hover(self, file: "Vehicle") -> float:
        """k_d of all rotors at the hover of the file, N s/m."""
        return self.rotor_drag * self.rotors * math.sqrt(file.hover_thrust())


def drawn_vehicle(random: np.random.Generator, spread: float) -> Vehicle:
    """A multirotor of 0.8 to 3 kg as built by hand: thrust 2.1 to 2.8 times the weight, 6 to 10 minutes of hover."""
    between = random.uniform
    rotors, mass = int(random.choice([4, 6])), math.exp(between(math.log(0.8), math.log(3.0)))
    arm = 0.24 * (mass / 1.5) ** 0.4 * between(0.9, 1.1) * (1.0 if rotors == 4 else 1.1)
    about_x = mass * arm**2 * between(0.17, 0.24)
    about_y = about_x * between(0.95, 1.15)
    inertia = np.array([about_x, about_y, (about_x + about_y) * between(0.78, 0.84)])
    radius = 0.47 * arm
    cells = 3 if mass < 1.2 else 4 if mass < 2.2 else 6
    full_voltage = 3.85 * cells
    dead_voltage = full_voltage * between(0.3, 0.42)
    hover = mass * GRAVITY / rotors
    linear = between(0.35, 0.6)  # share of the linear term in the thrust at full duty
    full = hover * between(2.1, 2.8) / (full_voltage - dead_voltage)
    power = 1 / (between(0.45, 0.6) * math.sqrt(2 * AIR * math.pi * radius**2))  # momentum theory over an efficiency
    current = power * rotors * hover**1.5 / full_voltage
    return Vehicle(
        rotors=rotors,
        mass=mass,
        inertia=inertia,
        arm=arm,
        com=np.zeros(2),
        ratio=between(0.1, 0.16) * radius,
        lag=between(0.025, 0.06),
        curve=full * np.array([linear / 100, (1 - linear) / 100**2]),
        dead_voltage=dead_voltage,
        share=1 + spread * random.standard_normal(rotors),
        rotor_drag=mass * between(0.12, 0.3) / (rotors * math.sqrt(hover)),
        friction=mass * between(0.06, 0.12),
        cells=cells,
        capacity=current * between(6, 10) / 60 / 0.8,
        resistance=cells * between(0.003, 0.006),
        power=power,
        wind=np.zeros(2),
    )


def damaged(effect: str, vehicle: Vehicle, random: np.random.Generator) -> tuple[Vehicle, str | None, int | None]:
    """The vehicle with a hidden effect of random size, the effect's id in the catalogue, and the rotor (from 1)."""
    real, between, identity, rotor = copy.deepcopy(vehicle), random.uniform, EFFECTS[effect], None
    sign, angle = random.choice([-1.0, 1.0]), between(0, 2 * math.pi)
    direction = np.array([math.cos(angle), math.sin(angle)])
    if effect == "rotor-loss":
        rotor = int(random.integers(real.rotors)) + 1
        real.share[rotor - 1] *= 1 - between(0.05, 0.25)
    elif effect == "extra-mass":  # a point in the centre of mass: inertias stay
        real.mass *= 1 + between(0.03, 0.15)
    elif effect == "centre-of-mass":
        real.com = real.com + between(0.003, 0.015) * direction
    elif effect == "drag-more":
        real.rotor_drag *= 1 + between(0.5, 1.5)
    elif effect == "drag-less":  # of the friction: the catalogue has no rotor drag below that of the file
        real.friction *= between(0.0, 0.5)
    elif effect == "capacity":
        real.capacity *= 1 - between(0.1, 0.3)
    elif effect == "wind":
        real.wind = between(1, 5) * direction
    elif effect == "torque-ratio":
        real.ratio *= 1 + sign * between(0.1, 0.3)
    elif effect == "inertia":
        axis = int(random.integers(3))
        real.inertia[axis] *= 1 + sign * between(0.1, 0.3)
        identity = f"inertia-{AXES[axis]}"
    elif effect == "lag":
        real.lag *= 1 + sign * between(0.2, 0.5)
    return real, identity, rotor


def described(vehicle: Vehicle, error: float, com_share: float, random: np.random.Generator) -> Vehicle:
    """What the file says of the vehicle as it was built (without its hidden effect): each constant a little off."""
    file, off = copy.deepcopy(vehicle), lambda: 1 + error * float(random.standard_normal())
    for name in ["mass", "arm", "ratio", "lag", "rotor_drag", "friction", "capacity", "resistance", "power"]:
        setattr(file, name, getattr(file, name) * off())
    file.inertia = file.inertia * np.array([off() for _ in range(3)])
    file.curve = file.curve * off()
    file.com = file.com + error * com_share * vehicle.arm * random.standard_normal(2)
    file.share = np.ones(vehicle.rotors)
    return file


def written(file: Vehicle, folder: pathlib.Path) -> pathlib.Path:
    """Vehicle and blade document in the folder; returns the vehicle's path."""
    full = float(file.curve @ [100, 100**2]) * (3.85 * file.cells - file.dead_voltage)
    rotors = "\n".join(
        f'    {{ number = {k + 1}, position_body_m = [{x:.9g}, {y:.9g}, 0.0], spin = "{"ccw" if spin > 0 else "cw"}",'
        f" moment_ratio_m = {file.ratio:.9g} }},"
        for k, ((x, y), spin) in enumerate(zip(file.places(), file.spins()))
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "blades.toml").write_text(
        f'description = "drawn at random"\n[blade.drawn]\nvoltage_offset_v = {file.dead_voltage:.9g}\n'
        f"coefficients = [0.0, {file.curve[0]:.9e}, {file.curve[1]:.9e}, 0.0]\n"
    )
    path = folder / "vehicle.toml"
    path.write_text(f"""name = "Drawn"
description = "a multirotor drawn at random"
[body]
mass_kg = {file.mass:.9g}
inertia_body_kg_m2 = [{", ".join(f"{value:.9g}" for value in file.inertia)}]
gravity_m_s2 = {GRAVITY}
linear_drag_kg_s = {file.friction:.9g}
angular_drag_nms = 0.0
[rotors]
blades = "blades.toml"
nominal_blade = "drawn"
thrust_lag_s = {file.lag:.9g}
full_thrust_n = {full:.9g}
drag_kg_s = {file.rotor_drag_in_hover(file):.9g}
[rotors.layout]
kind = "list"
rotor = [
{rotors}
]
[battery]
cells = {file.cells}
capacity_ah = {file.capacity:.9g}
internal_resistance_ohm = {file.resistance:.9g}
power_coefficient_w_per_n15 = {file.power:.9g}
cell_open_circuit_voltage_v = {CELL}
""")
    return path


def truth(effect: str, rotor: int | None, parameter: str, real: Vehicle, file: Vehicle) -> float:
    """The size that a parameter of an effect of the catalogue really has, given what the file says (see the top)."""
    if effect.startswith("inertia-") and effect.removeprefix("inertia-") in AXES:
        axis = AXES.index(effect.removeprefix("inertia-"))
        return real.inertia[axis] / file.inertia[axis] - 1
    if effect == "rotor-thrust-scale" and rotor is not None:
        return float(real.share[rotor - 1] / np.delete(real.share, rotor - 1).mean()) - 1
    shares = {"mass": "mass", "motor-time-constant": "lag", "moment-ratio": "ratio", "battery-capacity": "capacity"}
    shares["arm-length"] = "arm"
    if effect in shares:
        return getattr(real, shares[effect]) / getattr(file, shares[effect]) - 1
    return {
        ("air-density", "share"): float(np.median(real.share) * real.curve[0] / file.curve[0]) - 1,
        ("centre-of-mass", "forward_m"): real.com[0] - file.com[0],
        ("centre-of-mass", "right_m"): real.com[1] - file.com[1],
        ("rotor-drag", "drag_n_s_m"): real.rotor_drag_in_hover(file) - file.rotor_drag_in_hover(file),
        ("linear-friction", "drag_kg_s"): real.friction - file.friction,
        ("internal-resistance", "added_ohm"): real.resistance - file.resistance,
        ("wind", "north_m_s"): real.wind[0],
        ("wind", "east_m_s"): real.wind[1],
    }.get((effect, parameter), 0.0)


def as_shown(real: Vehicle, file: Vehicle) -> Vehicle:
    """The vehicle as the flight alone shows it: each constant as it would have to be if all others were the file's.

    From ratios that a flight shows: thrust over mass, thrust times arm over roll and pitch inertia, thrust times moment
    ratio over yaw inertia, drag over mass, power (k_P thrust^1.5) over capacity.
    """
    seen = copy.deepcopy(real)
    thrust, mass, arm = real.curve[0] / file.curve[0], real.mass / file.mass, real.arm / file.arm
    inertia, ratio, power = real.inertia / file.inertia, real.ratio / file.ratio, real.power / file.power
    seen.mass = real.mass / thrust
    seen.curve = real.curve / mass
    seen.inertia = real.inertia / thrust / np.array([arm, arm, ratio])
    seen.ratio = real.ratio * thrust / inertia[2]
    seen.arm = real.arm * thrust / inertia[:2].mean()
    seen.com = real.com * thrust / inertia[[1, 0]]
    seen.rotor_drag, seen.friction = real.rotor_drag * math.sqrt(thrust) / mass, real.friction / mass
    seen.capacity = real.capacity / (power * thrust**1.5)
    seen.resistance = real.resistance * power * thrust**1.5
    return seen


# ---- flights -------------------------------------------------------------------------------------------------------


def drawn_path(random: np.random.Generator, rate: int, duration_s: float) -> dict[str, np.ndarray]:
    """What the controller is asked for, by row: position and velocity (NED), yaw, roll and pitch to add, climb to add.

    Hovers, steps, a figure eight, climbs, turns, doublets of roll and pitch, and punches, in random order and sizes.
    """
    rows, between = int(duration_s * rate), random.uniform
    path = {"position": np.zeros((rows, 3)), "velocity": np.zeros((rows, 3)), "yaw": np.zeros(rows)}
    path |= {"tilt": np.zeros((rows, 2)), "punch": np.zeros(rows)}
    here, yaw = np.array([0.0, 0.0, -8.0]), between(-3, 3)
    kinds = random.permutation(["eight", "step", "step", "step", "climb", "turn", "turn", "roll", "pitch", "punch"])
    lasting = {"hover": 2, "eight": 8, "step": 3.2, "climb": 4.5, "turn": 2.2, "roll": 2.4, "pitch": 2.4, "punch": 2.4}
    edges = np.cumsum([0, 2] + [lasting[kind] for kind in kinds])
    edges = np.round(edges / edges[-1] * rows).astype(int)
    for kind, start, end in zip(["hover", *kinds], edges, edges[1:]):
        span, seconds = slice(start, end), np.arange(end - start) / rate
        size, block = random.choice([-1, 1]), between(0.25, 0.45)
        square = np.where(np.floor(seconds / block) % 2 == 0, 1.0, -1.0) * (seconds < 4 * block)
        if kind == "step":  # towards the origin if far from it
            there = between(3, 6) * np.array([math.cos(angle := between(0, 2 * math.pi)), math.sin(angle), 0.0])
            here = np.array([0.0, 0.0, here[2]]) + there
        elif kind == "climb":
            half = len(seconds) // 2
            path["position"][start : start + half, 2] += size * between(1.5, 3)
        elif kind == "turn":
            yaw += size * between(0.7, 1.6)
        elif kind in ("roll", "pitch"):
            path["tilt"][span, ["roll", "pitch"].index(kind)] = size * between(0.2, 0.35) * square
        elif kind == "punch":
            path["punch"][span] = size * between(2.5, 4) * square
        elif kind == "eight":
            turn = 2 * math.pi * random.integers(1, 3) * rate / len(seconds)  # rad/s
            wide, phase = between(1.5, 2.5), turn * seconds
            path["position"][span, :2] = wide * np.column_stack([np.sin(phase), np.sin(2 * phase) / 2])
            path["velocity"][span, :2] = wide * turn * np.column_stack([np.cos(phase), np.cos(2 * phase)])
        path["position"][span] += here
        path["yaw"][span] = yaw
    return path


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of quaternions (w, x, y, z)."""
    w = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(1, keepdims=True)
    return np.hstack([w, a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + cross(a[:, 1:], b[:, 1:])])


def turned(q: np.ndarray, vector: np.ndarray, back: bool = False) -> np.ndarray:
    """Body to NED, or back."""
    axis = -q[:, 1:] if back else q[:, 1:]
    twice = 2 * cross(axis, vector)
    return vector + q[:, :1] * twice + cross(axis, twice)


def from_euler(roll: np.ndarray, pitch: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Quaternion of ZYX Euler angles."""
    zero = np.zeros_like(roll)
    about_x = np.column_stack([np.cos(roll / 2), np.sin(roll / 2), zero, zero])
    about_y = np.column_stack([np.cos(pitch / 2), zero, np.sin(pitch / 2), zero])
    about_z = np.column_stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)])
    return product(product(about_z, about_y), about_x)


POSITION, VELOCITY, ATTITUDE, RATES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
THRUST, CHARGE = slice(13, 13 + ROTORS), 13 + ROTORS


class World:
    """Several vehicles at once, one per row of each array: the equations at the top of this file."""

    def __init__(self, vehicles: list[Vehicle]) -> None:
        padded = lambda values: np.pad(values, (0, ROTORS - len(values)))
        column = lambda name: np.array([getattr(one, name) for one in vehicles])[:, None]
        self.mass, self.lag, self.dead_voltage = column("mass"), column("lag"), column("dead_voltage")
        self.rotor_drag, self.friction, self.cells = column("rotor_drag"), column("friction"), column("cells")
        self.capacity, self.resistance, self.power = column("capacity"), column("resistance"), column("power")
        self.inertia = np.array([one.inertia for one in vehicles])
        self.linear, self.square = (np.array([[one.curve[k]] for one in vehicles]) for k in (0, 1))
        self.share = np.array([padded(one.share) for one in vehicles])
        self.wind = np.array([[*one.wind, 0.0] for one in vehicles])
        x, y = (np.array([padded(one.places()[:, k]) for one in vehicles]) for k in (0, 1))
        spin = np.array([padded(one.spins() * one.ratio) for one in vehicles])
        self.torque = np.stack([-y, x, spin], axis=1)  # torque of 1 N of each rotor, N m, (vehicles, 3, ROTORS)

    def voltage(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """At the terminals, V, and the electrical power, W: the upper solution of V^2 - V_oc V + R_in P = 0."""
        power = self.power * (np.maximum(y[:, THRUST], 0) ** 1.5).sum(1, keepdims=True)
        open_circuit = self.cells * np.interp(y[:, CHARGE:], np.linspace(0, 1, len(CELL)), CELL)
        return (open_circuit + np.sqrt(open_circuit**2 - 4 * self.resistance * power)) / 2, power

    def specific_force(self, y: np.ndarray, push: np.ndarray) -> np.ndarray:
        """What an accelerometer in the centre of mass reads, m/s^2, body."""
        air = turned(y[:, ATTITUDE], y[:, VELOCITY] - self.wind, back=True)
        thrust = np.maximum(y[:, THRUST], 0)
        force = push - self.friction * air
        force[:, :2] -= self.rotor_drag * np.sqrt(thrust).sum(1, keepdims=True) * air[:, :2]
        force[:, 2] -= thrust.sum(1)
        return force / self.mass

    def rate(self, y: np.ndarray, duty: np.ndarray, push: np.ndarray, twist: np.ndarray) -> np.ndarray:
        """Derivative of the state (position, velocity, attitude, body rates, thrusts, charge)."""
        change = np.empty_like(y)
        turning, attitude = y[:, RATES], y[:, ATTITUDE]
        change[:, POSITION] = y[:, VELOCITY]
        change[:, VELOCITY] = turned(attitude, self.specific_force(y, push)) + [0.0, 0.0, GRAVITY]
        change[:, ATTITUDE] = 0.5 * product(attitude, np.hstack([np.zeros((len(y), 1)), turning]))
        torque = (self.torque * y[:, None, THRUST]).sum(2) + twist
        change[:, RATES] = (torque - cross(turning, self.inertia * turning)) / self.inertia
        voltage, power = self.voltage(y)
        percent = 100 * duty
        static = self.share * (voltage - self.dead_voltage) * (self.linear * percent + self.square * percent**2)
        change[:, THRUST] = (static - y[:, THRUST]) / self.lag
        change[:, CHARGE:] = -power / (3600 * self.capacity * voltage)
        return change

    def stepped(self, y: np.ndarray, h: float, *inputs: np.ndarray) -> np.ndarray:
        """Runge-Kutta 4."""
        one = self.rate(y, *inputs)
        two = self.rate(y + h / 2 * one, *inputs)
        three = self.rate(y + h / 2 * two, *inputs)
        four = self.rate(y + h * three, *inputs)
        y = y + h / 6 * (one + 2 * two + 2 * three + four)
        y[:, ATTITUDE] /= np.linalg.norm(y[:, ATTITUDE], axis=1, keepdims=True)
        return y


class Controller:
    """Position, velocity, attitude, body rates: P loops, with integrals of velocity and rates.

    It knows the vehicle as it was built, without the hidden effect.
    """

    def __init__(self, vehicles: list[Vehicle], rate: int) -> None:
        self.world, self.h = World(vehicles), 1 / rate
        self.drift, self.trim = np.zeros((len(vehicles), 3)), np.zeros((len(vehicles), 3))
        up = np.where(self.world.share[:, None, :] > 0, 1.0, 0.0)
        self.mixer = np.linalg.pinv(np.concatenate([up, self.world.torque], axis=1))
        self.hover = np.array([[one.hover_thrust()] for one in vehicles])
        self.yaw_limit = 0.3 * np.array([one.ratio * one.mass * GRAVITY for one in vehicles])

    def duty(self, seen: SimpleNamespace, wanted: dict[str, np.ndarray]) -> np.ndarray:
        world = self.world
        speed = wanted["velocity"] + np.clip(1.2 * (wanted["position"] - seen.position), -3.5, 3.5)
        self.drift = np.clip(self.drift + 0.8 * self.h * np.clip(speed - seen.velocity, -1, 1), -4, 4)
        pull = np.clip(2.2 * (speed - seen.velocity), -5.0, 5.0) + self.drift
        pull[:, 2] -= wanted["punch"]
        w, x, y, z = seen.attitude.T
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        forward = np.cos(yaw) * pull[:, 0] + np.sin(yaw) * pull[:, 1]
        right = np.cos(yaw) * pull[:, 1] - np.sin(yaw) * pull[:, 0]
        down = np.maximum(GRAVITY - pull[:, 2], 3.0)
        pitch = np.clip(np.arctan2(-forward, down) + wanted["tilt"][:, 1], -0.6, 0.6)
        roll = np.clip(np.arctan2(right * np.cos(pitch), down) + wanted["tilt"][:, 0], -0.6, 0.6)
        error = product(seen.attitude * [1, -1, -1, -1], from_euler(roll, pitch, wanted["yaw"]))
        turning = np.clip(2 * np.sign(error[:, :1]) * error[:, 1:] * [5.5, 5.5, 2.5], [-4, -4, -1.2], [4, 4, 1.2])
        self.trim = np.clip(self.trim + 8 * self.h * (turning - seen.rates), -8, 8)
        torque = world.inertia * ([12.0, 12.0, 6.0] * (turning - seen.rates) + self.trim)
        torque[:, 2] = np.clip(torque[:, 2], -self.yaw_limit, self.yaw_limit)
        upright = 1 - 2 * (x * x + y * y)  # cosine of the tilt
        lift = world.mass[:, 0] * down / np.maximum(upright, 0.6)
        thrust = (self.mixer * np.column_stack([lift, torque])[:, None, :]).sum(2)
        thrust = np.where(world.share > 0, np.maximum(thrust, 0.15 * self.hover), 0)
        over = thrust / (seen.voltage - world.dead_voltage)
        percent = (np.sqrt(world.linear**2 + 4 * world.square * over) - world.linear) / (2 * world.square)
        return np.clip(percent / 100, 0, 1)


@dataclass
class Case:
    """One flight with one hidden effect."""

    seed: int
    effect: str
    built: Vehicle  # as its file ought to describe it
    real: Vehicle  # with the hidden effect
    id: str | None  # of the effect in the catalogue
    rotor: int | None
    rate: int  # rows per second

    def random(self, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, zlib.crc32(self.effect.encode()), purpose])

    def name(self) -> str:
        return f"{self.effect}-{self.seed}"


def drawn_case(seed: int, effect: str, spread: float) -> Case:
    case = Case(seed, effect, None, None, None, None, 0)  # type: ignore[arg-type]
    case.built = drawn_vehicle(case.random(0), spread)
    case.real, case.id, case.rotor = damaged(effect, case.built, case.random(1))
    case.rate = int(case.random(2).choice([250, 400]))
    return case


def fly(cases: list[Case], duration_s: float, noise: float = 1.0, substeps: int = 0) -> list[SimpleNamespace]:
    """Logs of flights at the same rate. `noise` scales the noise of sensors and the disturbances."""
    rate, count = cases[0].rate, len(cases)
    rows, substeps = int(duration_s * rate), substeps or (4 if rate == 250 else 3)
    world, controller = World([one.real for one in cases]), Controller([one.built for one in cases], rate)
    paths = [drawn_path(one.random(3), rate, duration_s) for one in cases]
    wanted = {key: np.stack([one[key] for one in paths], axis=1) for key in paths[0]}
    # Standard deviations: position m, velocity m/s, attitude rad, rates rad/s, accelerometer m/s^2, voltage V.
    draws = [one.random(4) for one in cases]
    levels = noise * np.array([[1e-3, 0.01, 8e-4, 6e-3, 0.08, 0.008] * draw.uniform(0.6, 1.6, 6) for draw in draws])
    dice = np.stack([draw.standard_normal((rows, 16 + 6)) for draw in draws], axis=1)
    mass, arm = (np.array([[getattr(one.built, name)] for one in cases]) for name in ("mass", "arm"))
    push = dice[:, :, 16:19] * 0.002 * noise * mass * GRAVITY
    twist = dice[:, :, 19:22] * 0.0006 * noise * mass * GRAVITY * arm
    y = np.zeros((count, CHARGE + 1))
    y[:, POSITION] = wanted["position"][0]
    y[:, ATTITUDE] = from_euler(np.zeros(count), np.zeros(count), wanted["yaw"][0])
    y[:, THRUST] = np.where(world.share > 0, controller.hover, 0)
    y[:, CHARGE] = [draw.uniform(0.5, 0.97) for draw in draws]
    keys = {"position": 3, "velocity": 3, "attitude": 4, "rates": 3, "accel": 3, "voltage": 1, "duty": ROTORS}
    keys["state"] = CHARGE + 1
    log = {key: np.empty((rows, count, wide)) for key, wide in keys.items()}
    for k in range(rows):
        error = [levels[:, j : j + 1] * dice[k, :, 3 * j : 3 * j + 3] for j in range(5)]
        tilted = product(y[:, ATTITUDE], np.hstack([np.ones((count, 1)), error[2] / 2]))
        seen = SimpleNamespace(
            position=y[:, POSITION] + error[0],
            velocity=y[:, VELOCITY] + error[1],
            attitude=tilted / np.linalg.norm(tilted, axis=1, keepdims=True),
            rates=y[:, RATES] + error[3],
            accel=world.specific_force(y, push[k]) + error[4],
            voltage=world.voltage(y)[0] + levels[:, 5:] * dice[k, :, 15:16],
            state=y,
        )
        seen.duty = controller.duty(seen, {key: values[k] for key, values in wanted.items()})
        for key in keys:
            log[key][k] = getattr(seen, key)
        for _ in range(substeps):
            y = world.stepped(y, 1 / (rate * substeps), seen.duty, push[k], twist[k])
    return [SimpleNamespace(rate=rate, **{key: values[:, k] for key, values in log.items()}) for k in range(count)]


def kept(log: SimpleNamespace, rotors: int, accelerometer: bool, path: pathlib.Path) -> None:
    """The canonical CSV (docs/logs.md)."""
    tilt = 1 - 2 * (log.state[:, 7] ** 2 + log.state[:, 8] ** 2)
    if not np.isfinite(log.state).all() or tilt.min() < math.cos(1.2) or np.abs(log.state[:, :2]).max() > 40:
        raise SystemExit(f"{path.name}: the controller lost this vehicle")
    names, columns = ["time_s"], [np.arange(len(log.duty)) / log.rate]
    groups = [("position", "position_{}_m", "north east down"), ("velocity", "velocity_{}_m_s", "north east down")]
    groups += [("attitude", "quat_{}", "w x y z"), ("rates", "{}_rate_rad_s", "roll pitch yaw")]
    groups += [("accel", "accel_{}_m_s2", "x y z")] if accelerometer else []
    groups += [("duty", "duty_{}", " ".join(str(k + 1) for k in range(rotors))), ("voltage", "battery_voltage_v", "-")]
    for group, pattern, axes in groups:
        for k, axis in enumerate(axes.split()):
            names.append(pattern.format(axis))
            columns.append(getattr(log, group)[:, k])
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part")
    np.savetxt(partial, np.column_stack(columns), fmt="%.9g", delimiter=",", header=",".join(names), comments="")
    partial.rename(path)


def flown(cases: list[Case], options: argparse.Namespace) -> dict[str, pathlib.Path]:
    """Logs of all cases, those that are not in the work folder flown in batches."""
    kind = f"flights-{options.duration_s:g}s-spread-{options.rotor_spread:g}"
    kind += "-without-accelerometer" * options.without_accelerometer
    paths = {one.name(): options.work / kind / f"{one.name()}.csv" for one in cases}
    missing = [one for one in cases if not paths[one.name()].exists()]
    for rate in (250, 400):
        batch = [one for one in missing if one.rate == rate]
        for some in (batch[k : k + 32] for k in range(0, len(batch), 32)):
            for case, log in zip(some, fly(some, options.duration_s)):
                kept(log, case.built.rotors, not options.without_accelerometer, paths[case.name()])
    return paths


# ---- answers -------------------------------------------------------------------------------------------------------


def judged(case: Case, file: Vehicle, said: dict) -> dict:
    """What the diagnosis says about a case, against the truth."""
    kind = said["verdict"]["kind"]
    findings = [*said["effects"], *said["sensor_or_timing"]]
    who = lambda one: (one["effect"], one.get("rotor"))
    named = [who(one["instance"]) for one in findings]
    others = [who(other) for one in findings for other in one["also_compatible"]]
    others += [(effect, case.rotor) for effect in said["verdict"].get("group", [])]
    blocking = [one for one in said.get("calibrate", []) if one["blocking"]]
    corrected = [(one["correction"].get("effect"), one["correction"].get("rotor")) for one in blocking]
    hidden = (case.id, case.rotor)
    if case.id is None:
        outcome = "right" if kind == "agrees" else "other"
    elif hidden in named and kind in ("missing", "partly-missing"):
        outcome = "right"
    elif kind == "calibrate-first":
        outcome = "calibrate" if hidden in corrected else "other"
    elif hidden in named and kind != "cannot-tell":
        outcome = "doubted"
    elif hidden in named or hidden in others:
        outcome = "alternative"
    else:
        outcome = "nothing" if kind == "agrees" else "other"
    values, shown_by_flight = [], as_shown(case.real, file)
    for one in findings:
        effect, rotor = who(one["instance"])
        for parameter in one["parameters"]:
            size, half = parameter.get("value"), parameter.get("interval_95")
            if size is None or not half:
                continue
            real = float(truth(effect, rotor, parameter["name"], case.real, file))
            row = {"effect": effect, "rotor": rotor, "parameter": parameter["name"], "unit": parameter["unit"]}
            row |= {"truth": real, "estimate": size, "half_width": half, "inside": abs(real - size) <= half}
            row |= {"z": (real - size) / (half / 1.96), "hidden": (effect, rotor) == hidden}
            row["truth_if"] = float(truth(effect, rotor, parameter["name"], shown_by_flight, file))
            row["inside_if"] = abs(row["truth_if"] - size) <= half
            if effect == "rotor-thrust-scale" and rotor:
                row["truth_of_file"] = float(case.real.share[rotor - 1] * case.real.curve[0] / file.curve[0]) - 1
            values.append(row)
    shown = [effect + (f" {rotor}" if rotor else "") for effect, rotor in named]
    shown += [f"calibrate {one['key']}" for one in blocking]
    return {"verdict": kind, "named": shown, "outcome": outcome, "values": values, "sentence": said["sentence"]}


def stated(file: Vehicle, vehicle: pathlib.Path, options: argparse.Namespace) -> None:
    """Tells the program how exact the file is: 95 % half widths, per cent, and mm for the centre of mass."""
    vehicle.with_suffix(".intervals.toml").unlink(missing_ok=True)
    command = [str(options.binary), "vehicle", "tolerances", str(vehicle), f"all={196 * options.file_error:g}%"]
    command += [f"centre-of-mass={1960 * options.file_error * options.com_share * file.arm:g}mm"]
    subprocess.run(command, check=True, capture_output=True)


def diagnosed(case: Case, log: pathlib.Path, options: argparse.Namespace) -> dict:
    """Runs the binary on a case; the answer is kept in the work folder."""
    file = described(case.built, options.file_error, options.com_share, case.random(5))
    kind = f"error-{options.file_error:g}" + "-stated" * options.stated
    folder = options.work / kind / case.name()
    vehicle = written(file, folder)
    if options.stated and options.file_error:
        stated(file, vehicle, options)
    command = [str(options.binary), "diagnose", str(log), "--model", str(vehicle), "--json"]
    began = time.monotonic()
    result = {"case": case.name(), "seed": case.seed, "hidden": case.effect, "id": case.id, "rotor": case.rotor}
    try:
        run = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=options.timeout_s)
        (folder / "diagnosis.json").write_text(run.stdout)
        result |= judged(case, file, json.loads(run.stdout))
    except subprocess.TimeoutExpired:
        result |= {"verdict": "timeout", "named": [], "outcome": "failed", "values": [], "sentence": ""}
    except (ValueError, KeyError) as problem:
        result |= {"verdict": f"exit {run.returncode}", "named": [], "outcome": "failed", "values": []}
        result["sentence"] = f"{run.stderr.strip()} ({problem!r})"
    return result | {"seconds": round(time.monotonic() - began, 2)}


def wilson(hits: int, of: int) -> str:
    """`k of n` with Wilson's 95 % interval."""
    if of == 0:
        return "0 of 0"
    share, z = hits / of, 1.96
    middle = (share + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(share * (1 - share) / of + z * z / (4 * of * of))
    return f"{hits} of {of} ({100 * max(0, middle - half):.0f}-{100 * min(1, middle + half):.0f} %)"


def totals(results: list[dict]) -> dict[str, str]:
    """Totals in words. Values count where the hidden effect was named."""
    hidden, healthy = ([one for one in results if (one["id"] is not None) == wanted] for wanted in (True, False))
    right = [one for one in hidden if one["outcome"] == "right"]
    own = [value for one in right for value in one["values"] if value["hidden"]]
    more = [value for one in results if one["outcome"] != "doubted" for value in one["values"] if not value["hidden"]]
    square = lambda values: f"{math.sqrt(sum(one['z'] ** 2 for one in values) / len(values)):.2f}" if values else "-"
    rows = {"named right": wilson(len(right), len(hidden))}
    rows["of these alone"] = wilson(sum(len(one["named"]) == 1 for one in right), len(right))
    for outcome in ["alternative", "doubted", "calibrate", "nothing", "other", "failed"]:
        rows[outcome] = str(sum(one["outcome"] == outcome for one in hidden))
    rows["healthy agrees"] = wilson(sum(one["outcome"] == "right" for one in healthy), len(healthy))
    rows["inside, named right"] = wilson(sum(one["inside"] for one in own), len(own))
    rows["r.m.s. of z"] = square(own)
    rows["inside, if the rest is right"] = wilson(sum(one["inside_if"] for one in own), len(own))
    for effect in list(EFFECTS)[1:]:
        some = [value for one in right if one["hidden"] == effect for value in one["values"] if value["hidden"]]
        rows[f"inside, {effect}"] = wilson(sum(one["inside"] for one in some), len(some)) + f", z {square(some)}"
    rows["inside, what else was named"] = wilson(sum(one["inside"] for one in more), len(more)) + f", z {square(more)}"
    seconds = sorted(one["seconds"] for one in results) or [0.0]
    rows["seconds, median and longest"] = f"{seconds[len(seconds) // 2]:.1f}, {seconds[-1]:.1f}"
    return rows


def table(results: list[dict]) -> str:
    """A line per parameter; values that belong to another than the hidden effect have a `+` in front of their name."""
    lines = [["case", "verdict", "named", "judged", "parameter", "truth", "estimate", "±", "inside", "z"]]
    for one in results:
        more = " and more" if one["outcome"] == "right" and len(one["named"]) > 1 else ""
        head = [one["case"], one["verdict"], ", ".join(one["named"]) or "-", one["outcome"] + more]
        for value in one["values"] or [None]:
            if value is None:
                lines.append([*head, "", "", "", "", "", ""])
                continue
            numbers = [f"{value[key]:.5g}" for key in ("truth", "estimate", "half_width")]
            name = ("" if value["hidden"] else f"+ {value['effect']} ") + value["parameter"]
            lines.append([*head, name, *numbers, "yes" if value["inside"] else "NO", f"{value['z']:.1f}"])
            head = [""] * 4
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines)


def compared(paths: list[pathlib.Path]) -> None:
    """Totals of two results side by side, and the cases whose outcome or inside differs."""
    both = [json.loads(path.read_text())["cases"] for path in paths]
    sums = [totals(one) for one in both]
    for key in sums[0]:
        print(f"{key:30} {sums[0][key]:32} {sums[1][key]}")
    first, second = ({one["case"]: one for one in cases} for cases in both)

    def brief(one: dict) -> str:
        values = [value for value in one["values"] if value["hidden"]]
        sizes = [f"{it['estimate']:.4g} ± {it['half_width']:.2g}" + " OUT" * (not it["inside"]) for it in values]
        return f"{one['outcome']} ({', '.join(one['named'])}) {'; '.join(sizes)}"

    for name in [name for name in first if name in second and brief(first[name]) != brief(second[name])]:
        print(f"{name}:\n    {brief(first[name])}\n    {brief(second[name])}")


# ---- checks of the simulator ---------------------------------------------------------------------------------------


def check(duration_s: float) -> None:
    """What can be said of the simulator without a binary: errors, which have to be small, and what the flights do."""
    cases = [drawn_case(seed, effect, 0.0) for effect in EFFECTS for seed in (1, 2)]
    cases = [case for case in cases if case.rate == 250]
    world, random = World([one.built for one in cases]), np.random.default_rng(1)
    y, zero = np.zeros((len(cases), CHARGE + 1)), np.zeros((len(cases), ROTORS))
    y[:, ATTITUDE], y[:, CHARGE] = [1, 0, 0, 0], 0.8
    y[:, VELOCITY], y[:, RATES] = random.normal(0, 3, (len(cases), 3)), random.normal(0, 3, (len(cases), 3))
    world.friction = world.friction * 0

    def preserved(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Energy, J, and angular momentum in NED, N m s, of a free body."""
        turning = (world.inertia * y[:, RATES] ** 2).sum(1) / 2
        energy = world.mass[:, 0] * ((y[:, VELOCITY] ** 2).sum(1) / 2 - GRAVITY * y[:, 2]) + turning
        return energy, turned(y[:, ATTITUDE], world.inertia * y[:, RATES])

    before = preserved(y)
    for _ in range(2400):
        y = world.stepped(y, 1 / 1200, zero, zero[:, :3], zero[:, :3])
    errors = [np.abs(late - early).max() / np.abs(early).max() for early, late in zip(before, preserved(y))]
    print("2 s of free fall, tumbling, no drag: energy {:.1e}, angular momentum {:.1e} (relative)".format(*errors))
    coarse, fine = (fly(cases[:4], duration_s / 3, noise=0.0, substeps=substeps) for substeps in (4, 8))
    change = max(np.abs(a.state - b.state)[:, :13].max() for a, b in zip(coarse, fine))
    print(f"half the step: {change:.1e} (largest change of position, velocity, attitude or rate, SI)")
    worst: dict[str, float] = {}
    logs = fly(cases, duration_s, noise=0.0)
    for case, log in zip(cases, logs):
        state, real, h = log.state, case.real, 1 / log.rate
        weight, mean = real.mass * GRAVITY, lambda values: (values[1:] + values[:-1]) / 2  # trapezoidal rule over a row
        torque = state[:, THRUST] @ World([real]).torque[0].T - cross(state[:, RATES], real.inertia * state[:, RATES])
        step = product(state[:-1, ATTITUDE] * [1, -1, -1, -1], state[1:, ATTITUDE])[:, 1:] * 2 / h
        change = np.diff(state, axis=0) / h
        used = real.power * (state[:, THRUST] ** 1.5).sum(1) / log.voltage[:, 0] / (3600 * real.capacity)
        gaps = {
            "velocity' m/s²": change[:, VELOCITY] - mean(turned(state[:, ATTITUDE], log.accel) + [0, 0, GRAVITY]),
            "attitude' rad/s": step - mean(state[:, RATES]),
            "torque over weight and arm": (change[:, RATES] * real.inertia - mean(torque)) / (weight * real.arm),
            "charge' over its mean": (change[:, CHARGE] + mean(used)) / used.mean(),
        }
        if case.effect == "none":
            hover = state[int(0.05 * len(state)), THRUST].sum()
            gaps["thrust over weight in hover"] = np.array(hover / weight - 1)
        for name, gap in gaps.items():
            worst[name] = max(worst.get(name, 0.0), float(np.sqrt((gap**2).mean())))
    print("r.m.s. errors of logs without noise: " + ", ".join(f"{key} {value:.1e}" for key, value in worst.items()))
    spans = {
        "top speed, m/s": [np.linalg.norm(log.state[:, VELOCITY], axis=1).max() for log in logs],
        "mean duty": [log.duty[:, : case.built.rotors].mean() for case, log in zip(cases, logs)],
        "largest duty": [log.duty.max() for log in logs],
        "charge used": [log.state[0, CHARGE] - log.state[-1, CHARGE] for log in logs],
        "least height, m": [-log.state[:, 2].max() for log in logs],
    }
    print("flights: " + "; ".join(f"{key} {min(some):.2g} to {max(some):.2g}" for key, some in spans.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog="More: header of this file")
    path = pathlib.Path
    add = parser.add_argument
    add("--binary", type=path, default=path("target/release/rotortwin"), help="the program to measure")
    add("--seeds", default="1-5", metavar="A-B", help="first and last seed (default 1-5)")
    add("--effects", nargs="+", default=list(EFFECTS), choices=EFFECTS, metavar="EFFECT", help=", ".join(EFFECTS))
    add("--file-error", type=float, default=0.005, metavar="E", help="relative error of the file's constants (1 sigma)")
    add("--exact", action="store_true", help="the file is exact: --file-error 0")
    add("--stated", action="store_true", help="the program is told E (rotortwin vehicle tolerances)")
    add("--com-share", type=float, default=0.2, help="the centre of mass is this times E times the arm off (0.2)")
    add("--rotor-spread", type=float, default=0.0, help="relative deviation of the thrust of single rotors (0)")
    add("--duration-s", type=float, default=36.0, help="length of a flight, s (36)")
    add("--without-accelerometer", action="store_true", help="logs without specific force")
    add("--jobs", type=int, default=1, help="diagnoses at a time (1)")
    add("--timeout-s", type=float, default=600.0, help="for one diagnosis, s (600)")
    add("--work", type=path, default=path("coverage-of-intervals"), help="folder for flights, files and answers")
    add("--out", type=path, help="results as JSON")
    add("--compare", type=path, nargs=2, metavar="JSON", help="two results side by side; nothing is run")
    add("--check", action="store_true", help="checks the simulator; nothing is diagnosed")
    options = parser.parse_args()
    if options.compare:
        return compared(options.compare)
    if options.check:
        return check(options.duration_s)
    options.file_error *= not options.exact
    options.binary, options.work = options.binary.resolve(), options.work.resolve()
    first, _, last = options.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    cases = [drawn_case(seed, effect, options.rotor_spread) for effect in options.effects for seed in seeds]
    logs = flown(cases, options)
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        results = list(pool.map(lambda case: diagnosed(case, logs[case.name()], options), cases))
    if options.out:
        settings = {key: str(value) for key, value in vars(options).items()}
        options.out.write_text(json.dumps({"options": settings, "cases": results}, indent=1))
    print(f"file error {options.file_error:g}, centre of mass {options.com_share:g} of it, {options.duration_s:g} s\n")
    print(table(results) + "\n")
    for key, value in totals(results).items():
        print(f"{key:30} {value}")


if __name__ == "__main__":
    main()
