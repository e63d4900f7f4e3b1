import { expect, test } from "vitest";
import { type Compared, linesOf } from "./controllers";

const row = (more: object) => ({
  run: "a", controller: "ours", link: "in-process", status: "done", scenario: "s", vehicle: "f550", model_hash: "0", seed: 1, simulated_s: 10, false_alarms: 0, ...more,
}) as unknown as Compared["rows"][number];

test("what no flight has is no row, and what one lacks is a dash", () => {
  const lines = linesOf({ within_m: 0.5, differences: [], rows: [row({ position_m: { rms: 0.123456, max: 1 } }), row({ controller: "ardupilot", lockstep: true, false_alarms: 2 })] });
  const of = (name: string) => lines.find((line) => line.name === name)?.cells;
  expect(of("position error, rms")).toEqual(["0.123 m", "–"]);
  expect(of("lockstep")).toEqual(["–", "yes"]);
  expect(of("false alarms")).toEqual(["0", "2"]);
  expect(of("energy")).toBeUndefined();
  expect(lines.some((line) => line.name.includes("again after"))).toBe(false);
});

test("what a fault did is told with its onset and the bound of the recovery", () => {
  const fault = { description: "rotor 3: −10 % thrust", onset_s: 30, right_at_end: true, farthest_m: 0.4, isolated_after_s: 1.5 };
  const lines = linesOf({ within_m: 0.5, differences: [], rows: [row({ fault }), row({ fault: { ...fault, right_at_end: false, recovered_after_s: 0 } })] });
  const told = Object.fromEntries(lines.map((line) => [line.name, line.cells]));
  expect(told["isolated after"]).toEqual(["1.50 s", "1.50 s"]);
  expect(told["right at the end"]).toEqual(["yes", "no"]);
  expect(told["within 0.500 m again after"]).toEqual(["–", "0 s"]);
  expect(told["rotor 3: −10 % thrust from 30.0 s on: detected after"]).toBeUndefined();
});
