import { describe, expect, it } from "vitest";
import { levels } from "./coaxial";

const at = (x: number, y: number, z = 0) => ({ position_body_m: [x, y, z] });

describe("rotors that share an axis", () => {
  it("counts those above, z points down", () => {
    expect(levels([at(0.2, 0.2, 0.03), at(0.2, 0.2, -0.03), at(-0.2, -0.2)])).toEqual([1, 0, 0]);
  });
  it("takes the later one as the lower where heights say nothing", () => {
    expect(levels([at(0.2, 0), at(-0.2, 0), at(0.2, 0), at(-0.2, 0)])).toEqual([0, 0, 1, 1]);
  });
  it("leaves flat frames alone", () => {
    expect(levels([at(0.2, 0.05), at(0.2, -0.05), at(-0.2, 0)])).toEqual([0, 0, 0]);
  });
});
