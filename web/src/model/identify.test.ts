import { describe, expect, it } from "vitest";
import { type Estimate, adviceOf, nameFrom, nameProblem, numberOf, rotorsOf } from "./identify";

describe("a vehicle from a log", () => {
  it("makes names that the library takes of names of files", () => {
    expect(["Flight 7 (windy).BIN", "log", "__.csv", "..ulg", "Ä.ulg", "x".repeat(99)].map(nameFrom)).toEqual(["flight-7-windy", "log", "mine", "mine", "mine", "x".repeat(40)]);
  });
  it("says what is wrong with a name", () => {
    expect(["mine", "7.a_b-c"].map(nameProblem)).toEqual([undefined, undefined]);
    for (const bad of ["", "Mine", "a b", "-a", "<script>", "x".repeat(65)]) expect(nameProblem(bad)).toContain(`'${bad}' is no name`);
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
});
