import { describe, expect, it } from "vitest";
import { rangeOf } from "./axis";

describe("range of an axis", () => {
  it("is wide enough for its ticks, however little the values vary", () => {
    for (const value of [2, -5, 90, 0.5, 16.34, 1e-9]) {
      for (let share = 1; share > 1e-17; share /= 1.7) {
        for (const [least, largest] of [[value, value + Math.abs(value) * share], [value - Math.abs(value) * share, value]] as const) {
          const [from, to] = rangeOf(least, largest) as [number, number];
          const size = Math.max(Math.abs(from), Math.abs(to));
          expect(to - from, `${least} to ${largest}`).toBeGreaterThan(1e-6 * size);
          expect(from <= least && to >= largest, `${least} to ${largest} in ${from} to ${to}`).toBe(true);
        }
      }
    }
  });
  it("shows zero and nothing", () => {
    expect(rangeOf(null, null)).toEqual([null, null]);
    const [from, to] = rangeOf(0, 0) as [number, number];
    expect(to).toBeGreaterThan(from);
  });
});
