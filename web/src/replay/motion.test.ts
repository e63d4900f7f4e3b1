import { describe, expect, it } from "vitest";
import { type Geometry, namedRotors, poseAt } from "./motion";

const geometry: Geometry = {
  name: "quad",
  arm_m: 0.2,
  rotors: [1, 2, 3, 4].map((number) => ({ number, position_body_m: [0, 0, 0], spin: "cw" })),
  hover: { rotor_thrust_n: [2, 2, 2, 2] },
};

describe("pose of the 3-D picture", () => {
  it("reads names of verdict codes", () => {
    expect([-3, 0, 4, 203].map(namedRotors)).toEqual([[], [], [4], [2, 3]]);
  });
  it("interpolates motion, holds verdicts, and gives a loss to the rotor that is named", () => {
    const track = {
      time: [0, 1],
      data: {
        true_position_north_m: [0, 2], true_position_east_m: [0, 0], true_position_down_m: [-1, -1],
        true_roll_rad: [0, 0.2], verdict_sequential: [302, 302], thrust_loss_share: [0.05, 0.05], second_thrust_loss_share: [0.1, 0.1],
        suspect_rotors: [6, 6], true_thrust_1_n: [1, 3], duty_2: [0.5, 0.5],
      },
    };
    const pose = poseAt(track, geometry, 0.5);
    expect(pose?.position).toEqual([1, 0, -1]);
    expect(pose?.attitude[0]).toBeCloseTo(0.1);
    expect(pose?.loss).toEqual([0, 0.1, 0.05, 0]);
    expect(pose?.suspect).toEqual([false, true, true, false]);
    expect(pose?.thrust).toEqual([2, 2, 0, 0]);
    expect(poseAt({ time: [], data: {} }, geometry, 0)).toBeUndefined();
  });
});
