import { describe, expect, it } from "vitest";
import { type Draft, NOTHING, Table, isOfAnotherProgram, placesOfFinding, refusalWithoutCommand } from "./table";

const column = (name: string, unit: string | null = null, numbers = 100, examples = ["1"]) => ({ name, unit, examples, low: numbers > 0 ? 0 : null, high: numbers > 0 ? 1 : null, numbers, cells: 100 });
const row = (to: string, from: string[], more: object = {}) => ({ to, from, unit: null, frame: null, low: null, high: null, evidence: "by name", ...more });
const draft: Draft = {
  mapping: "",
  layout: { separator: ";", decimal: ",", skip_lines: 1, clock: "Zeit", clock_format: "ms", rate_hz: null, evidence: "its name" },
  columns: [column("Zeit"), column("gx", "deg/s"), column("gy"), column("gz"), column("M1"), column("M2"), column("M3"), column("vx"), column("vy"), column("vz"), column("Mode", null, 0, ["AUTO"])],
  rows: [row("rates", ["gx", "gy", "gz"], { unit: "rad/s", frame: "frd" }), row("duty", ["M1", "M2", "M3"], { low: 1000, high: 2000 })],
  questions: [],
  left_out: ["vx", "vy", "vz", "Mode"],
};
const table = (choice: Partial<Table["choice"]> = {}) => new Table(draft, { ...NOTHING, ...choice });

describe("a table of another program", () => {
  it("is read as drafted where nothing is chosen", () => {
    expect(table().wrong().size).toBe(0);
    const mapping = table().mapping();
    expect(mapping).toContain('separator = ";"\ndecimal = ","\nskip_lines = 1\nclock = "Zeit"\nclock_format = "ms"');
    expect(mapping).toContain('to = "duty"\nfrom = "csv:M1,M2,M3"\nlow = 1000.0\nhigh = 2000.0\n');
    expect(mapping).not.toContain("order");
  });
  it("keeps what a header states, and follows what was chosen for one axis", () => {
    const chosen = table({ unit: { gy: "deg/s" } });
    expect(["gx", "gy", "gz"].map((name) => chosen.unit(name))).toEqual(["deg/s", "deg/s", "deg/s"]);
    expect(chosen.mapping()).toContain('to = "rates"\nfrom = "csv:gx,gy,gz"\nunit = "deg/s"\nframe = "frd"');
    expect(table({ unit: { gy: "rpm" } }).mapping()).toContain('to = "roll_rate_rad_s"\nfrom = "csv:gx"\nunit = "deg/s"');
  });
  it("writes motors in the order in which they were chosen", () => {
    const chosen = table({ meaning: { M1: "duty_3", M3: "duty_1" }, low: "1000", high: "1950" });
    expect(chosen.mapping()).toContain('from = "csv:M3,M2,M1"\nlow = 1000.0\nhigh = 1950.0\norder = [1, 2, 3]');
  });
  it("turns single columns of a vector as the whole vector", () => {
    const part = table({ meaning: { vx: "velocity_north_m_s", vz: "velocity_down_m_s" }, frame: { velocity: "enu" } });
    expect(part.mapping()).toContain('to = "velocity_east_m_s"\nfrom = "csv:vx"\nunit = "m/s"\n');
    expect(part.mapping()).toContain('to = "velocity_down_m_s"\nfrom = "csv:vz"\nunit = "m/s"\nfactor = -1.0');
    expect(part.mapping()).not.toContain('to = "velocity_north_m_s"');
  });
  it("says at each field what is wrong", () => {
    const field = (choice: Partial<Table["choice"]>) => [...table(choice).wrong().keys()];
    expect(field({ meaning: { vx: "roll_rate_rad_s" } })).toEqual(["column vx"]);
    expect(field({ meaning: { M2: "" } })).toEqual(["column M3"]);
    expect(field({ meaning: { Mode: "battery_voltage_v" } })).toEqual(["column Mode"]);
    expect(field({ meaning: { Zeit: "" } })).toEqual(["rate"]);
    expect(field({ meaning: { Zeit: "" }, rate: "400" })).toEqual([]);
    expect(field({ clock: "hh:mm:ss" })).toEqual(["clock"]);
    expect(field({ low: "2000", high: "1000" })).toEqual(["duty"]);
    expect(field({ high: "full" })).toEqual(["duty"]);
    expect(field({ meaning: { vx: "quat_w" } })).toEqual(["column vx"]);
    expect(field({ meaning: Object.fromEntries(draft.columns.map((one) => [one.name, ""])), rate: "100" })).toEqual(["all"]);
  });
  it("finds the field that a sentence of the import is about", () => {
    expect(table().placesOf("f.csv: row 2, column pitch_rate_rad_s: 'x' is not a number")).toEqual(["column gy"]);
    expect(table().placesOf("f.csv: csv:gx,gy,gz: the unit cannot be right: the median is 3 in rad/s")).toEqual(["column gx"]);
    expect(table().placesOf("f.csv: row 2, column time_s: 0 s after 1 s; time must increase")).toEqual(["clock"]);
    expect(table().placesOf("f.csv: something else")).toEqual([]);
    expect(placesOfFinding(table(), { kind: "rates_in_degrees", detail: "" })).toEqual(["column gx"]);
  });
  it("takes up what a finding suggests", () => {
    expect(table().mended({ kind: "body_axes_flu", detail: "" })?.frame).toEqual({ rates: "flu" });
    expect(table().mended({ kind: "swapped_motors", detail: "as if duty_1 drives rotor 2, duty_2 drives rotor 1" })?.meaning).toEqual({ M1: "duty_2", M2: "duty_1", M3: "duty_3" });
    expect([table().mended({ kind: "accel_in_g", detail: "" }), table().mended({ kind: "no_flight", detail: "" })]).toEqual([undefined, undefined]);
  });
  it("leaves the advice for the command line out", () => {
    const refusal = "f.csv: column time_s is missing (found: a, b); a table of another program: `rotortwin log map FILE` drafts a mapping for it";
    expect([isOfAnotherProgram(refusal), refusalWithoutCommand(refusal)]).toEqual([true, "f.csv: column time_s is missing (found: a, b). It is a table of another program: say in step 2 what its columns are."]);
    expect(refusalWithoutCommand("f.csv: row 1 has 2 cells; the header has 1 columns (a table of another program: `rotortwin log map FILE` drafts a mapping for it)")).toMatch(/^f\.csv: row 1 has 2 cells; the header has 1 columns\. It is a table/);
    expect(refusalWithoutCommand("f.csv: csv:b: the unit cannot be right: the median is 1.0 in m/s2; set the unit of 'accel' in a mapping")).toBe("f.csv: csv:b: the unit cannot be right: the median is 1.0 in m/s2");
  });
});
