import { describe, expect, it } from "vitest";
import { type Bin, type ChannelResult, type Comparison, type Diagnosis, type History, type LogComparison, comparisonSentence, evidenceWords, keyOf, lineTo, partAt, remainderOf, timesWithin, togetherByReason } from "./twin";

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

describe("a comparison and a diagnosis of one model", () => {
  const channel = (name: string, more: Partial<ChannelResult> = {}): ChannelResult => ({
    channel: name, group: "torque", unit: "rad/s²", verdict: "agrees", samples: 1000, conditions: [], inputs: [], strip: [], smoothed_rms: 1, smoothed_noise: 1, low_frequency: 1, ...more,
  });
  const slightlyOff = channel("mx", { verdict: "fails", smoothed_rms: 1.09, low_frequency: 1.52 });
  const compared = (channels: ChannelResult[], name = "flight"): Comparison => ({
    models: [{ label: "f550@v0", hash: "h0", effects: [] }, { label: "f550@v1", hash: "h1", effects: ["inertia-roll"] }],
    logs: [{ log: { name, hash: "l" }, models: [{ model: "f550@v0", agrees: false, channels: [channel("my", { verdict: "fails" })] }, { model: "f550@v1", agrees: channels.every((one) => one.verdict !== "fails"), chi2: 1, channels }] }],
  }) as unknown as Comparison;
  const diagnosed = (kind: string, logs = ["flight"], hash = "h1"): Diagnosis => ({ verdict: { kind }, model: { name: "f550", hash }, logs, sentence: "" }) as unknown as Diagnosis;

  it("names the channel of a remainder that nothing of the catalogue explains", () => {
    const found = compared([channel("fx"), slightlyOff]);
    expect(remainderOf(diagnosed("agrees"), found)).toBe("roll moment (mx): error 1.09 × noise, but it lasts (means over 0.25 s: chi²/N 1.52)");
    expect(comparisonSentence(found.logs[0] as LogComparison)).toBe("f550@v1 fails in roll moment (mx): error 1.09 × noise, but it lasts (means over 0.25 s: chi²/N 1.52).");
  });
  it("names the flight if there are several", () => {
    expect(remainderOf(diagnosed("agrees", ["flight", "other"]), compared([slightlyOff], "other"))).toMatch(/^in other roll moment/);
  });
  it("says nothing where both agree, where the diagnosis names something, and of another model or flight", () => {
    expect(remainderOf(diagnosed("agrees"), compared([channel("mx")]))).toBeUndefined();
    expect(remainderOf(diagnosed("missing"), compared([slightlyOff]))).toBeUndefined();
    expect(remainderOf(diagnosed("agrees", ["flight"], "h2"), compared([slightlyOff]))).toBeUndefined();
    expect(remainderOf(diagnosed("agrees", ["held-out"]), compared([slightlyOff]))).toBeUndefined();
    expect(remainderOf(diagnosed("agrees"), undefined)).toBeUndefined();
  });
  it("names four channels and counts the others, the worst first", () => {
    const many = ["fx", "fy", "fz", "mx", "my"].map((name, k) => channel(name, { verdict: "fails", smoothed_rms: 3, low_frequency: 2 + k }));
    expect(comparisonSentence(compared(many).logs[0] as LogComparison)).toMatch(/^f550@v1 fails in pitch moment \(my\): error 3\.00 × noise; .*; and 1 more\.$/);
    expect(comparisonSentence(compared([channel("mx"), channel("fx")]).logs[0] as LogComparison)).toBe("f550@v1 agrees with this flight: 2 channels are at their noise (chi²/N 1.00).");
  });
});
