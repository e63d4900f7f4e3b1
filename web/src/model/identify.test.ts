import { describe, expect, it } from "vitest";
import { type Estimate, adviceOf, answerOf, bandWords, predicted, groupsOf, knownHow, nameFrom, nameProblem, numberOf, rotorsOf } from "./identify";

describe("a vehicle from a log", () => {
  it("makes names that the library takes of names of files", () => {
    expect(["Flight 7 (windy).BIN", "log", "__.csv", "..ulg", "Ä.ulg", "x".repeat(99)].map(nameFrom)).toEqual(["flight-7-windy", "log", "mine", "mine", "mine", "x".repeat(40)]);
  });
  it("says what is wrong with a name", () => {
    expect(["mine", "7.a_b-c"].map(nameProblem)).toEqual([undefined, undefined]);
    for (const bad of ["", "Mine", "a b", "-a", "<script>", "x".repeat(65)]) expect(nameProblem(bad)).toContain(`'${bad}' is not a valid document name`);
  });
  it("says what is wrong with a number", () => {
    expect(numberOf(" 1,5 ", "Mass", "kg")).toEqual({ value: 1.5 });
    expect(numberOf("", "Mass", "kg").problem).toBe("Mass: expected a number, kg.");
    for (const bad of ["-1", "0", "1e999", "two"]) expect(numberOf(bad, "Mass", "kg").problem).toContain(`'${bad}'`);
  });
  it("finds the rotors in the document", () => {
    const text = 'rotor = [\n    { number = 1, position_body_m = [0.1414, 0.1414, 0.0], spin = "ccw", moment_ratio_m = 0.016 },\n    { number = 2, position_body_m = [-0.1414, -0.1414, 0.0], spin = "cw", moment_ratio_m = 0.016 },\n]\n';
    expect(rotorsOf(text)).toEqual([
      { number: 1, position_body_m: [0.1414, 0.1414, 0], spin: "ccw" },
      { number: 2, position_body_m: [-0.1414, -0.1414, 0], spin: "cw" },
    ]);
    expect(rotorsOf("[rotors]")).toBeUndefined();
  });
  it("says each advice once", () => {
    const value = (name: string, source: Estimate["source"], better: string): Estimate => ({ key: "", name, unit: "", value: 1, low: 0, high: 2, source, how: "", better });
    expect(adviceOf([value("a", "class", "yaw steps"), value("b", "log", "nothing"), value("c", "log-and-class", "yaw steps"), value("d", "class", "")])).toEqual([
      { better: "yaw steps", names: ["a", "c"] },
    ]);
  });
  it("says plainly how much is known, and never counts a guess or what was entered as known", () => {
    const value = (name: string, source: Estimate["source"]): Estimate => ({ key: name, name, unit: "", value: 1, low: 0, high: 2, source, how: "", better: "" });
    const values = [value("mass", "entered"), value("lag", "log"), value("c", "bench"), value("drag", "class"), value("n", "log-and-class"), value("centre", "assumed")];
    const answer = answerOf(values);
    expect(answer.head).toBe("2 of 4 constants are known.");
    expect(answer.rest).toBe("A guess from vehicles of this size: drag. Narrowed by the flight, not settled: n.");
    expect(answerOf(values.slice(0, 3))).toEqual({ head: "Every constant is known.", rest: "", kind: "good" });
    expect(groupsOf(values).map((group) => group.values.map((one) => one.name))).toEqual([["lag", "c"], ["drag", "n"], ["mass", "centre"]]);
  });
  it("has words for a prediction that is worse than none, and names a source once", () => {
    expect([predicted(-10.8), predicted(0.5), predicted(0.9996)]).toEqual(["worse than the mean", "50.0 %", "100.0 %"]);
    expect(knownHow({ source: "entered", how: "entered; the motion agrees" })).toBe("entered; the motion agrees");
    expect(knownHow({ source: "parameter", how: "FRAME_CLASS 1" })).toBe("parameter in the log (FRAME_CLASS 1)");
  });
  it("has words for a band", () => {
    expect(bandWords({ low_hz: 0.1, high_hz: 4 })).toBe("0.1 to 4 Hz");
  });
});
