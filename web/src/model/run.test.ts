import { describe, expect, it } from "vitest";
import { Collector, thinned, type Interval, type Score, type Summary, faultIntervals, kindOfScore, lateWords, otherwise, peersOf } from "./run";

const start = { type: "start", run: "r", status: "running", channels: [{ name: "a", unit: "m" }], rate_hz: 20 } as const;
const sample = (time: number, a: number | null) => ({ type: "sample", time_s: time, step: Math.round(time * 400), values: { a } }) as const;

describe("Collector", () => {
  it("joins history and samples without a hole or a double", () => {
    const collector = new Collector();
    collector.take({ ...start, channels: [...start.channels] });
    expect(collector.take({ type: "history", step: [0, 40], time_s: [0, 0.1], values: { a: [1, 2] }, thinned: false })).toBe(true);
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

describe("who flew, and who was late", () => {
  it("names link, pace, controller and causes", () => {
    const summary = { link: "iceoryx2", pace: "real-time", controller: { peer: "rotortwin-controller", version: "0.1.0", lockstep: true } } as Summary;
    expect(peersOf(summary)).toBe("iceoryx2, real time; controller: rotortwin-controller 0.1.0, in lockstep");
    expect(peersOf({ link: "in-process", pace: "fast", controller: { peer: "Betaflight at 127.0.0.1:9001", lockstep: false } } as Summary)).toContain("not in lockstep");
    expect(lateWords({ who: "fdi", why: "scheduler", steps: 1, worst_ms: 4.1234 })).toBe("FDI engine waited for a processor: 1 step, 4.12 ms at worst");
  });
});

describe("scores of an interval", () => {
  const score = (more: Partial<Score>): Score => ({ not_ready: 0, right: 95, share_right: 0.95, healthy: 0, unknown: 0, other_rotor: 0, isolated_after_s: 0.2, false_alarm_events: 0, false_alarm_windows: 0, verdict_at_end: 3, ...more });
  const interval = (more: Partial<Interval>) => ({ start_s: 45, end_s: 60, fault_label: 3, expected_verdict: 3, ...more }) as Interval;
  it("is good with a fault if the rotor stays named, so-so if it is lost again, bad if it never is", () => {
    expect(kindOfScore(interval({}), score({}))).toBe("good");
    expect(kindOfScore(interval({}), score({ share_right: 0.85 }))).toBe("warn");
    expect(kindOfScore(interval({}), score({ verdict_at_end: 0 }))).toBe("warn");
    expect(kindOfScore(interval({}), score({ isolated_after_s: null }))).toBe("bad");
    expect(kindOfScore(interval({}), score({ share_right: null }))).toBe("");
  });
  it("is good without a fault if there is no false alarm", () => {
    const healthy = interval({ fault_label: 0, expected_verdict: 0 });
    expect(kindOfScore(healthy, score({ verdict_at_end: 0, isolated_after_s: null }))).toBe("good");
    expect(kindOfScore(healthy, score({ verdict_at_end: 0, false_alarm_events: 2 }))).toBe("warn");
    // Rotor 3 was named before, and still is.
    expect(kindOfScore(healthy, score({ verdict_at_end: 3, share_right: 0, other_rotor: 400, isolated_after_s: null }))).toBe("bad");
    expect(kindOfScore(healthy, score({ verdict_at_end: 0, share_right: 0.5, other_rotor: 200, isolated_after_s: null }))).toBe("warn");
    expect(otherwise(healthy, score({ other_rotor: 4, not_ready: 160, healthy: 95 }))).toBe("4 named a rotor, 160 no verdict yet");
    expect(otherwise(interval({}), score({ healthy: 1, unknown: 13 }))).toBe("1 healthy, 13 unknown");
  });
  it("shades faults of rotors and of sensors", () => {
    const summary = { intervals: [interval({ fault_label: 0, start_s: 0, end_s: 45 }), interval({}), interval({ fault_label: 0, start_s: 60, end_s: 75, sensor_faults: ["gyro bias"] })] } as Summary;
    expect(faultIntervals(summary)).toEqual([[45, 60], [60, 75]]);
    expect(faultIntervals(undefined)).toEqual([]);
  });
});

describe("thinned", () => {
  it("keeps the first and the last row, and the same rows when more come", () => {
    const of = (rows: number) => ({ time: Array.from({ length: rows }, (_, k) => k), data: { a: Array.from({ length: rows }, (_, k) => 10 * k) }, units: {} });
    expect(thinned(of(10), 10).time).toEqual(of(10).time);
    expect(thinned(of(11), 5)).toEqual({ time: [0, 3, 6, 9, 10], data: { a: [0, 30, 60, 90, 100] }, units: {} });
    expect(thinned(of(13), 5).time).toEqual([0, 3, 6, 9, 12]);
  });
});
