import { describe, expect, it } from "vitest";
import { Collector } from "./run";

const start = { type: "start", status: "running", channels: [{ name: "a", unit: "m" }], rate_hz: 20 } as const;
const sample = (time: number, a: number | null) => ({ type: "sample", time_s: time, step: Math.round(time * 400), values: { a } }) as const;

describe("Collector", () => {
  it("joins history and samples without a hole or a double", () => {
    const collector = new Collector();
    collector.take({ ...start, channels: [...start.channels] });
    expect(collector.take({ type: "history", time_s: [0, 0.1], values: { a: [1, 2] }, thinned: false })).toBe(true);
    collector.take(sample(0.1, 2));
    collector.take(sample(0.2, null));
    expect(collector.time).toEqual([0, 0.1, 0.2]);
    expect(collector.data["a"]).toEqual([1, 2, null]);
  });
  it("begins again when the run does", () => {
    const collector = new Collector();
    collector.take({ ...start, channels: [...start.channels] });
    collector.take(sample(9, 1));
    collector.take(sample(0, 5));
    expect(collector.time).toEqual([0]);
    expect(collector.data["a"]).toEqual([5]);
  });
});
