import { describe, expect, it } from "vitest";
import { type History, evidenceWords, keyOf, lineTo } from "./twin";

const version = (number: number, parent: number | null) => ({ version: number, label: `f550@v${number}`, hash: `h${number}`, parent, note: "", changed: [], effects: [], made_ms: 0 });

describe("versions and keys", () => {
  it("walks from the first version to the head, past an undone one", () => {
    const history: History = { name: "f550", begun: true, vehicle: "F550", branches: [], versions: [version(0, null), version(1, 0), version(2, 0), version(3, 2)] };
    expect(lineTo(history, 3).map((one) => one.version)).toEqual([0, 2, 3]);
    expect(lineTo(history, 9)).toEqual([]);
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
