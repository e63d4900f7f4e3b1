import { describe, expect, it } from "vitest";
import { parseExact, jsonWithSeed } from "./exact";

describe("seeds", () => {
  it("are exact beyond 2^53, and numbers below", () => {
    const text = '{"seed":18446744073709551615,"summary":{"seed": 7},"flight_seed" : 9007199254740993, "text":"\\"seed\\": 18446744073709551615"}';
    expect(parseExact(text)).toEqual({ seed: "18446744073709551615", summary: { seed: 7 }, flight_seed: "9007199254740993", text: '"seed": 18446744073709551615' });
  });
  it("are sent as they were typed", () => {
    expect(jsonWithSeed({ scenario: "hover", seed: "18446744073709551615", set: [] })).toBe('{"scenario":"hover","seed":18446744073709551615,"set":[]}');
    expect(jsonWithSeed({ seed: "007" })).toBe('{"seed":7}');
  });
});
