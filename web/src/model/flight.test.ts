import { describe, expect, it } from "vitest";
import { type FlightPicture, eventLanes, flightSentence, outputLines, partLane, rotorSpeedWords } from "./flight";

const event = (kind: string, start_s: number, end_s: number, output: number | null, detail = kind) => ({ kind, start_s, end_s, output, detail });
const flight = {
  name: "f", start_s: 0, end_s: 100,
  parts: {
    parts: [{ kind: "ground", start_s: 0, end_s: 10, why: "" }, { kind: "air", start_s: 10, end_s: 100, why: "" }],
    events: [event("saturated", 20, 20.1, 3), event("lost-rotor", 60, 80, 2, "rotor of output 2 is lost"), event("gap", 90, 92, null)],
  },
  outputs: [{ output: 1, mean: [0.5, null], low: [0.4, null], high: [1, null] }],
  output_limit: 1,
} as unknown as FlightPicture;

describe("a flight", () => {
  it("gives each kind of part its own words, also where they look alike", () => {
    const parts = ["ground", "take-off", "air", "landing", "hover"].map((kind, k) => ({ kind, start_s: k, end_s: k + 1 }));
    const lane = partLane(parts as never);
    expect(lane.stretches.map((one) => lane.words?.(one.code))).toEqual(["on the ground", "taking off", "in the air", "landing", "not known"]);
    expect(lane.stretches.every((one) => one.code <= 0)).toBe(true);
  });
  it("gives each kind of event a lane, wide enough to be seen, with its motor", () => {
    const lanes = eventLanes(flight);
    expect(lanes.map((one) => one.name)).toEqual(["saturated", "lost rotor", "no rows"]);
    expect(lanes[0]?.stretches).toEqual([{ from: 20, to: 20.1, code: 3 }]);
    expect(lanes[0]?.least).toBe(0.4);
    expect([lanes[0]?.words?.(3), lanes[1]?.words?.(2), lanes[2]?.words?.(-1)]).toEqual(["motor 3 at its limit", "rotor 2 lost", "gap"]);
  });
  it("marks a motor at its limit that the mean hides", () => {
    expect(outputLines(flight)).toEqual([{ output: 1, duty: [50, null], saturated: [100, null] }]);
  });
  it("says what happened", () => {
    expect(flightSentence(flight)).toBe("90.0 of 100.0 s in the air; saturated: 1 ×; rotor of output 2 is lost; no rows: 1 ×.");
    expect(rotorSpeedWords([{ rotor: 1, low_hz: 80.2, median_hz: 91, high_hz: 99.7 }])).toBe("rotor 1 91 Hz (80 to 100)");
  });
});
