import { describe, expect, it } from "vitest";
import { constantsOf } from "./constants";

const VERSION = `
format = 1
[vehicle]
name = "mine"

# How well the vehicle's constants are known, with 95 % intervals.
[[constant]]
key = "body.mass_kg"
name = "mass"
unit = "kg"
value = 2.1
low = 2.1
high = 2.1
source = "entered"
how = 'as "given"'
better = ""

[[constant]]
key = "inertia"
name = "roll inertia \\u03a9"
unit = "kg m²"
value = 1e-5
low = -0.5
high = 2_000.0
source = "class"
how = "a \\"guess\\" \\\\ of the class"
better = "fly: roll doublets"

[other]
low = 3
`;

describe("constants of a version", () => {
  it("are read as the server writes them", () => {
    expect(constantsOf(VERSION)).toEqual([
      { key: "body.mass_kg", name: "mass", unit: "kg", value: 2.1, low: 2.1, high: 2.1, source: "entered", how: 'as "given"', better: "" },
      { key: "inertia", name: "roll inertia Ω", unit: "kg m²", value: 1e-5, low: -0.5, high: 2000, source: "class", how: 'a "guess" \\ of the class', better: "fly: roll doublets" },
    ]);
    expect(constantsOf("[vehicle]\nname = 'mine'\n")).toEqual([]);
  });
  it("are refused where they are otherwise", () => {
    expect(() => constantsOf(VERSION.replace("value = 2.1\n", ""))).toThrow("constant 1 of the vehicle has no `value`");
    expect(() => constantsOf(VERSION.replace("value = 2.1\n", "value = nan\n"))).toThrow("`value` is no number: nan");
    expect(() => constantsOf(VERSION.replace('"class"', '"oracle"'))).toThrow("`source` is oracle");
    expect(() => constantsOf(VERSION.replace('name = "mass"', 'name = """'))).toThrow("`name` is no text of one line");
  });
});
