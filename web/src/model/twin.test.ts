import { describe, expect, it } from "vitest";
import { type Bin, type History, evidenceWords, keyOf, lineTo, partAt, timesWithin, togetherByReason } from "./twin";

const version = (number: number, parent: number | null) => ({ version: number, label: `f550@v${number}`, hash: `h${number}`, parent, note: "", changed: [], effects: [], made_ms: 0 });

describe("versions and keys", () => {
  it("walks from the first version to the head, past an undone one", () => {
    const history: History = { name: "f550", begun: true, vehicle: "F550", rotors: 6, branches: [], versions: [version(0, null), version(1, 0), version(2, 0), version(3, 2)] };
    expect(lineTo(history, 3).map((one) => one.version)).toEqual([0, 2, 3]);
    expect(lineTo(history, 9)).toEqual([]);
  });
  it("puts effects together that could not be considered for the same reason", () => {
    const one = (label: string, columns: string[], setting: string | null = null) => ({ effect: label, label, columns, setting, reason: columns.length ? "no height" : "in the model" });
    const rows = togetherByReason([one("Ground effect", ["height_m"]), one("Rotor drag", [], "a model without rotor-drag"), one("Ceiling effect", ["height_m"]), one("Mass", [], "a model without mass")]);
    expect(rows.map((row) => row.labels)).toEqual([["Ground effect", "Ceiling effect"], ["Rotor drag"], ["Mass"]]);
    expect(rows[0]?.columns).toEqual(["height_m"]);
  });
  it("gives equal keys to equal work only", () => {
    expect(keyOf({ a: 1 })).toBe(keyOf({ a: 1 }));
    expect(keyOf({ a: 1 })).not.toBe(keyOf({ a: 2 }));
    expect(keyOf("x")).toMatch(/^[0-9a-f]{16}$/);
  });
  it("says between which values a bin lies, and when", () => {
    const bins = [1, 3, 4].map((at): Bin => ({ at, mean: 0, band_95: 0, chi2: 1, blocks: 9 }));
    expect([0, 1, 2].map((place) => partAt(bins, place)).map((one) => [one?.low, one?.high])).toEqual([[-Infinity, 2], [2, 3.5], [3.5, Infinity]]);
    expect(partAt(bins, 3)).toBeUndefined();
    const conditions = { bucket_s: 0.5, time_s: [0.25, 0.75, 1.25, 1.75, 2.25], items: [{ name: "speed", mean: [2.5, 3, null, 3.2, 9] }] };
    const middle = { bin: bins[1] as Bin, low: 2, high: 3.5 };
    expect(timesWithin(conditions, "speed", middle)).toEqual([[0, 1], [1.5, 2]]);
    expect(timesWithin(conditions, "height", middle)).toEqual([]);
  });
  it("calls evidence above 10 decisive", () => {
    expect([1, 3, 6, 11].map(evidenceWords)).toEqual(["weak", "moderate", "strong", "decisive"]);
  });
});
