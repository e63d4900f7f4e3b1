import { describe, expect, it } from "vitest";
import { bytes, duration, plusMinus, short, verdictText } from "./format";

describe("numbers for people", () => {
  it("keeps three digits", () => {
    expect([0.123456, 12.3456, 1234.5, -0.5, 0, null, NaN].map((value) => short(value))).toEqual(["0.123", "12.3", "1235", "−0.500", "0", "–", "–"]);
    expect(short(0.0000123)).toBe("1.23·10⁻⁵");
  });
  it("writes value and interval to the same place", () => {
    expect(plusMinus(0.24968, 0.00112, "N·s/m")).toBe("0.2497 ± 0.0011 N·s/m");
    expect(plusMinus(-12.345, 0.5, "%")).toBe("−12.35 ± 0.50 %");
    expect(plusMinus(0.00002999, 0.00000025, "N·s")).toBe("(2.999 ± 0.025)·10⁻⁵ N·s");
    expect(plusMinus(1.5, 0, "1")).toBe("1.50");
  });
  it("names verdict codes", () => {
    expect([-4, -3, -2, -1, 0, 3, 104, 1012].map(verdictText)).toEqual([
      "cannot judge",
      "ambiguous", "not ready", "unknown fault", "healthy", "rotor 3", "rotors 1 and 4", "rotors 10 and 12",
    ]);
  });
  it("scales bytes and durations", () => {
    expect([0, 999, 12345, 5.2e9].map(bytes)).toEqual(["0 B", "999 B", "12.3 kB", "5.20 GB"]);
    expect([0, 0.0087, 0.25, 42, 185, 239.7, 7200].map(duration)).toEqual(["0.0 s", "8.7 ms", "0.3 s", "42 s", "3 min 5 s", "4 min 0 s", "2 h 0 min"]);
  });
});
