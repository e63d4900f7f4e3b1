import { describe, expect, it } from "vitest";
import { Pace } from "./pace";

/** Ratios for frames that arrive every `gap` ms. */
const run = (pace: Pace, from: number, gap: number, count: number) => Array.from({ length: count }, (_, k) => pace.ratio(from + k * gap));

describe("pace of the 3-D picture", () => {
  it("takes points away while pictures come late, and gives a still picture all of them", () => {
    const pace = new Pace();
    expect(run(pace, 0, 16, 100).every((one) => one === 1)).toBe(true);
    expect(run(pace, 1600, 60, 60).at(-1)).toBe(0.5);
    expect(pace.isReduced()).toBe(true);
    expect(pace.ratio(10_000)).toBe(1);
    expect(pace.ratio(10_016)).toBe(0.5);
  });
  it("holds pictures back where even small ones are late", () => {
    const pace = new Pace();
    run(pace, 0, 60, 60);
    expect(pace.pause()).toBe(0);
    run(pace, 3600, 120, 24);
    expect(pace.pause()).toBe(100);
    run(pace, 6480, 110, 8 * 12);
    expect(pace.pause()).toBe(0);
  });
  it("gives them back once there is room", () => {
    const pace = new Pace();
    run(pace, 0, 60, 30);
    expect(run(pace, 1800, 16, 200).at(-1)).toBe(1);
  });
});
