import { describe, expect, it } from "vitest";
import { type History, evidenceWords, keyOf, lineTo, togetherByReason } from "./twin";

const version = (number: number, parent: number | null) => ({ version: number, label: `f550@v${number}`, hash: `h${number}`, parent, note: "", changed: [], effects: [], made_ms: 0 });

describe("versions and keys", () => {
  it("walks from the first version to the head, past an undone one", () => {
    const history: History = { name: "f550", begun: true, vehicle: "F550", branches: [], versions: [version(0, null), version(1, 0), version(2, 0), version(3, 2)] };
    expect(lineTo(history, 3).map((one) => one.version)).toEqual([0, 2, 3]);
    expect(lineTo(history, 9)).toEqual([]);
  });
  it("puts effects together that could not be considered for the same reason", () => {
    const one = (label: string, columns: string[], setting: string | null = null) => ({ label, columns, setting, reason: columns.length ? "no height" : "in the model" });
    const rows = togetherByReason([one("Ground effect", ["height_m"]), one("Rotor drag", [], "a model without rotor-drag"), one("Ceiling effect", ["height_m"]), one("Mass", [], "a model without mass")]);
    expect(rows.map((row) => row.labels)).toEqual([["Ground effect", "Ceiling effect"], ["Rotor drag"], ["Mass"]]);
    expect(rows[0]?.columns).toEqual(["height_m"]);
  });
  it("gives equal keys to equal work only", () => {
    expect(keyOf({ a: 1 })).toBe(keyOf({ a: 1 }));
    expect(keyOf({ a: 1 })).not.toBe(keyOf({ a: 2 }));
    expect(keyOf("x")).toMatch(/^[0-9a-f]{16}$/);
  });
  it("calls evidence above 10 decisive", () => {
    expect([1, 3, 6, 11].map(evidenceWords)).toEqual(["weak", "moderate", "strong", "decisive"]);
  });
});
