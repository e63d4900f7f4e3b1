/**
 * A table of another program: what each of its columns means, chosen on top of a draft of the server, and the mapping (TOML) that follows.
 *
 * Everything that can be wrong with a choice has a field, at which the complaint stands.
 */
import type { Schemas } from "../api/client";
import { orderIn } from "./repair";

export type Draft = Schemas["TableDraft"];
export type Column = Schemas["TableColumn"];

/** Our axis `k` is the file's axis `[0]` times `[1]`. */
type Turn = readonly [number, 1 | -1];
const SAME: readonly Turn[] = [[0, 1], [1, 1], [2, 1]];
const HALF: readonly Turn[] = [[0, 1], [1, -1], [2, -1]];
const EAST: readonly Turn[] = [[1, 1], [0, 1], [2, -1]];

interface Frame {
  key: string;
  words: string;
  /** How single columns turn; undefined: only all together can. */
  turns?: readonly Turn[];
}
export interface Quantity {
  key: string;
  title: string;
  /** Our columns, and what each is called here. */
  parts: readonly (readonly [string, string])[];
  units: readonly (readonly [string, string])[];
  frames: readonly Frame[];
}

const BODY: readonly Frame[] = [{ key: "frd", words: "x forward, y right, z down", turns: SAME }, { key: "flu", words: "x forward, y left, z up", turns: HALF }];
const WORLD: readonly Frame[] = [
  { key: "ned", words: "x north, y east, z down", turns: SAME }, { key: "enu", words: "x east, y north, z up", turns: EAST }, { key: "nwu", words: "x north, y west, z up", turns: HALF },
];
const ATTITUDE: readonly Frame[] = [
  { key: "ned-frd", words: "body forward, right, down to north, east, down", turns: SAME }, { key: "nwu-flu", words: "body forward, left, up to north, west, up", turns: HALF },
  { key: "enu-flu", words: "body forward, left, up to east, north, up" },
];
const GEODETIC = "geodetic";
const METRES: Quantity["units"] = [["m", "m"], ["cm", "cm"], ["mm", "mm"], ["ft", "ft"]];
/** As many as a vehicle has rotors at most. */
const ROTORS = 16;
const numbered = (stem: string, end: string, words: string) => Array.from({ length: ROTORS }, (_, k) => [`${stem}${k + 1}${end}`, `${words} ${k + 1}`] as const);

export const QUANTITIES: readonly Quantity[] = [
  { key: "duty", title: "Motor outputs", parts: numbered("duty_", "", "motor"), units: [], frames: [] },
  { key: "rates", title: "Body rates (gyroscope)", parts: [["roll_rate_rad_s", "rate about x (roll)"], ["pitch_rate_rad_s", "rate about y (pitch)"], ["yaw_rate_rad_s", "rate about z (yaw)"]], units: [["rad/s", "rad/s"], ["deg/s", "deg/s"], ["rpm", "rpm"]], frames: BODY },
  { key: "accel", title: "Accelerometer", parts: [["accel_x_m_s2", "acceleration x"], ["accel_y_m_s2", "acceleration y"], ["accel_z_m_s2", "acceleration z"]], units: [["m/s2", "m/s²"], ["g", "g"], ["mg", "mg"]], frames: BODY },
  { key: "attitude", title: "Attitude: roll, pitch, yaw", parts: [["roll_rad", "roll angle"], ["pitch_rad", "pitch angle"], ["yaw_rad", "yaw angle"]], units: [["rad", "rad"], ["deg", "degrees"], ["cdeg", "centidegrees"]], frames: ATTITUDE },
  { key: "quaternion", title: "Attitude: quaternion", parts: [["quat_w", "quaternion w"], ["quat_x", "quaternion x"], ["quat_y", "quaternion y"], ["quat_z", "quaternion z"]], units: [], frames: ATTITUDE.map(({ key, words }) => ({ key, words })) },
  { key: "velocity", title: "Velocity", parts: [["velocity_north_m_s", "velocity x"], ["velocity_east_m_s", "velocity y"], ["velocity_down_m_s", "velocity z"]], units: [["m/s", "m/s"], ["cm/s", "cm/s"], ["mm/s", "mm/s"], ["km/h", "km/h"]], frames: WORLD },
  { key: "position", title: "Position", parts: [["position_north_m", "position x"], ["position_east_m", "position y"], ["position_down_m", "position z"]], units: METRES, frames: [...WORLD, { key: GEODETIC, words: "x latitude, y longitude (degrees), z altitude (m)" }] },
  { key: "rotor_speed", title: "Rotor speeds", parts: numbered("rotor_speed_", "_rad_s", "rotor speed"), units: [["rpm", "rpm"], ["rad/s", "rad/s"]], frames: [] },
  { key: "battery_voltage_v", title: "Battery voltage", parts: [["battery_voltage_v", "battery voltage"]], units: [["V", "V"], ["cV", "cV"], ["mV", "mV"]], frames: [] },
  { key: "battery_current_a", title: "Battery current", parts: [["battery_current_a", "battery current"]], units: [["A", "A"], ["cA", "cA"], ["mA", "mA"]], frames: [] },
  { key: "height_above_ground_m", title: "Height above ground", parts: [["height_above_ground_m", "height above ground"]], units: METRES, frames: [] },
];
/** Meaning of the column that holds the time. */
export const TIME = "time";
export const CLOCKS: readonly (readonly [string, string])[] = [
  ["s", "seconds"], ["ms", "milliseconds"], ["us", "microseconds"], ["ns", "nanoseconds"], ["mm:ss", "mm:ss"], ["hh:mm:ss", "hh:mm:ss"], ["date hh:mm:ss", "date hh:mm:ss"],
];
const PLAIN_CLOCKS = ["s", "ms", "us", "ns"];

/** What was chosen or typed, on top of the draft. A key that is missing: as drafted. */
export interface Choice {
  /** By column: one of our columns, `time`, or "" (not used). */
  meaning: Record<string, string>;
  unit: Record<string, string>;
  /** By quantity. */
  frame: Record<string, string>;
  clock?: string;
  rate?: string;
  low?: string;
  high?: string;
}
export const NOTHING: Choice = { meaning: {}, unit: {}, frame: {} };

/** A choice as it was stored; nothing, if that cannot be read. */
export function choiceOf(text: string): Choice {
  try {
    return { ...NOTHING, ...(JSON.parse(text) as Partial<Choice>) };
  } catch {
    return NOTHING;
  }
}

const quantityOf = (meaning: string) => QUANTITIES.find((one) => one.parts.some(([part]) => part === meaning));
const rowOf = (draft: Draft, key: string) => draft.rows.find((row) => row.to === key);

/** Draft and choice together: what the form shows, and the mapping is made of. */
export class Table {
  constructor(
    readonly draft: Draft,
    readonly choice: Choice,
  ) {}

  /** As drafted. */
  private drafted(column: string): string {
    if (this.draft.layout.clock === column) return TIME;
    for (const row of this.draft.rows) {
      const place = row.from.indexOf(column);
      const part = place < 0 ? undefined : QUANTITIES.find((one) => one.key === row.to)?.parts[place];
      if (part) return part[0];
    }
    return "";
  }
  meaning(column: string): string {
    return this.choice.meaning[column] ?? this.drafted(column);
  }
  quantity(column: string): Quantity | undefined {
    return quantityOf(this.meaning(column));
  }
  /** Columns of a meaning. */
  columns(meaning: string): string[] {
    return this.draft.columns.map((one) => one.name).filter((name, place, all) => all.indexOf(name) === place && this.meaning(name) === meaning);
  }
  /** Columns of a quantity, in its order. */
  of(quantity: Quantity): string[] {
    return quantity.parts.flatMap(([part]) => this.columns(part));
  }
  quantities(): Quantity[] {
    return QUANTITIES.filter((one) => this.of(one).length > 0);
  }
  unit(column: string): string {
    const quantity = this.quantity(column);
    const first = quantity?.units[0]?.[0];
    if (!quantity || first === undefined) return "";
    const fits = (unit: string | null | undefined) => quantity.units.some(([known]) => known === unit);
    const own = this.choice.unit[column];
    if (own !== undefined && fits(own)) return own;
    const stated = this.draft.columns.find((one) => one.name === column)?.unit;
    if (stated && fits(stated)) return stated;
    // Three axes of one sensor have one unit: what was chosen for one is meant for all.
    const sibling = this.of(quantity).map((name) => this.choice.unit[name]).find((unit) => unit !== undefined && fits(unit));
    const drafted = rowOf(this.draft, quantity.key)?.unit;
    return sibling ?? (fits(drafted) ? drafted ?? first : first);
  }
  frame(quantity: Quantity): string {
    return this.choice.frame[quantity.key] ?? rowOf(this.draft, quantity.key)?.frame ?? quantity.frames[0]?.key ?? "";
  }
  clock(): string {
    return this.choice.clock ?? this.draft.layout.clock_format ?? "s";
  }
  rate(): string {
    return this.choice.rate ?? (this.draft.layout.rate_hz != null ? String(this.draft.layout.rate_hz) : "");
  }
  low(): string {
    return this.choice.low ?? String(rowOf(this.draft, "duty")?.low ?? 1000);
  }
  high(): string {
    return this.choice.high ?? String(rowOf(this.draft, "duty")?.high ?? 2000);
  }

  /** What is wrong, by field: `column NAME`, `clock`, `rate`, `duty`, or `all`. */
  wrong(): Map<string, string> {
    const found = new Map<string, string>();
    const facts = new Map(this.draft.columns.map((one) => [one.name, one]));
    for (const quantity of QUANTITIES) {
      for (const [part, words] of quantity.parts) {
        const [first, ...more] = this.columns(part);
        for (const name of more) found.set(`column ${name}`, `${first} is the ${words} already: one column for each.`);
      }
      const names = this.of(quantity);
      for (const name of names) {
        const column = facts.get(name);
        if (column?.numbers === 0) found.set(`column ${name}`, `None of its cells is a number (${column.examples.map((cell) => `'${cell}'`).join(", ")}).`);
      }
      const whole = quantity.parts.every(([part]) => this.columns(part).length > 0);
      const together = names.length > 0 && (quantity.key === "quaternion" || this.frame(quantity) === GEODETIC || (this.frame(quantity) === "enu-flu" && this.columns("yaw_rad").length > 0));
      if (together && quantity.frames.length > 0 && !whole) {
        found.set(`column ${names[0]}`, `With these axes ${quantity.title.toLowerCase()} needs all ${quantity.parts.length} columns.`);
      }
      if (quantity.key === "duty" || quantity.key === "rotor_speed") {
        const gap = quantity.parts.slice(0, names.length).find(([part]) => this.columns(part).length === 0);
        if (gap) found.set(`column ${names.at(-1)}`, `There is no ${gap[1]}: number them from 1, without gaps.`);
      }
    }
    const [time, ...others] = this.columns(TIME);
    for (const name of others) found.set(`column ${name}`, `${time} is the time already: one column holds it.`);
    if (time === undefined) {
      const rate = numberIn(this.rate());
      if (rate === undefined || rate <= 0 || rate > 1e5) found.set("rate", `'${this.rate()}' is no number of rows per second above 0; or choose the column that is the time.`);
    } else {
      const cells = facts.get(time);
      const plain = PLAIN_CLOCKS.includes(this.clock());
      if (cells && plain && cells.numbers === 0) found.set("clock", `The cells of ${time} are no plain numbers ('${cells.examples[0] ?? ""}'): choose how the time is written.`);
      if (cells && !plain && cells.numbers > 0) found.set("clock", `The cells of ${time} are plain numbers ('${cells.examples[0] ?? ""}'), not ${this.clock()}.`);
    }
    if (this.columns("duty_1").length > 0) {
      const [low, high] = [numberIn(this.low()), numberIn(this.high())];
      if (low === undefined || high === undefined) found.set("duty", `'${low === undefined ? this.low() : this.high()}' is no number.`);
      else if (high <= low) found.set("duty", `Full throttle (${high}) must be more than zero throttle (${low}).`);
    }
    if (this.quantities().length === 0) found.set("all", "No column has a meaning yet: choose at least the motor outputs, the body rates and the accelerometer.");
    return found;
  }

  /** The mapping, as `rotortwin log import --mapping` takes it. */
  mapping(): string {
    const { separator, decimal, skip_lines } = this.draft.layout;
    const [time] = this.columns(TIME);
    const lines = ['source = "csv"', "", "[csv]", `separator = ${text(separator)}`, `decimal = ${text(decimal)}`, ...(skip_lines > 0 ? [`skip_lines = ${skip_lines}`] : [])];
    lines.push(...(time === undefined ? [`rate_hz = ${float(numberIn(this.rate()) ?? 0)}`] : [`clock = ${text(time)}`, `clock_format = ${text(this.clock())}`]));
    for (const quantity of this.quantities()) {
      for (const row of this.rows(quantity)) lines.push("", "[[column]]", ...row);
    }
    return `${lines.join("\n")}\n`;
  }

  private rows(quantity: Quantity): string[][] {
    const names = this.of(quantity);
    const from = (columns: readonly string[]) => `from = ${text(`csv:${columns.join(",")}`)}`;
    const units = [...new Set(names.map((name) => this.unit(name)))];
    const unit = (name: string | undefined) => (quantity.units.length === 0 || name === undefined ? [] : [`unit = ${text(this.unit(name))}`]);
    if (quantity.key === "duty") {
      const drafted = rowOf(this.draft, "duty")?.from ?? [];
      // Outputs that the owner put into order are taken as they stand; of guessed ones the import looks for those that drive rotors.
      const order = drafted.join() === names.join() ? [] : [`order = [${names.map((_, k) => k + 1).join(", ")}]`];
      return [['to = "duty"', from(names), `low = ${float(numberIn(this.low()) ?? 0)}`, `high = ${float(numberIn(this.high()) ?? 1)}`, ...order]];
    }
    const frame = quantity.frames.find((one) => one.key === this.frame(quantity));
    const whole = names.length === quantity.parts.length;
    if (quantity.key === "rotor_speed" && units.length === 1) return [['to = "rotor_speed"', from(names), ...unit(names[0])]];
    if (frame && whole && units.length === 1) {
      const geodetic = frame.key === GEODETIC;
      return [[`to = ${text(quantity.key)}`, from(names), ...(geodetic ? [] : unit(names[0])), `frame = ${text(frame.key)}`]];
    }
    // Single columns: of the file's axis that is ours.
    return quantity.parts.flatMap(([part], k) => {
      const [axis, sign] = frame?.turns?.[k] ?? [k, 1];
      const theirs = quantity.parts[axis]?.[0];
      const [name] = theirs === undefined ? [] : this.columns(theirs);
      return name === undefined ? [] : [[`to = ${text(part)}`, from([name]), ...unit(name), ...(sign < 0 ? ["factor = -1.0"] : [])]];
    });
  }

  /** The fields that a sentence of the server is about; empty: the table as a whole. */
  placesOf(sentence: string): string[] {
    if (/time_s|csv\.clock|time must increase|without a time/.test(sentence)) return [this.columns(TIME).length > 0 ? "clock" : "rate"];
    const canonical = /column (\w+)/.exec(sentence)?.[1] ?? "";
    if (/^duty_\d+$/.test(canonical) || /means duty 1/.test(sentence)) return ["duty"];
    const quantity = quantityOf(canonical);
    const named = /(?:^|\s)csv:(\S.*?): /.exec(sentence)?.[1]?.split(",") ?? [];
    const own = canonical === "" ? [] : this.columns(canonical);
    const about = own.length > 0 ? own : quantity ? this.of(quantity) : named.filter((name) => this.quantity(name));
    return about.slice(0, 1).map((name) => `column ${name}`);
  }

  /** The choice with what a finding of the import suggests; undefined if no choice of this form says it. */
  mended(finding: { kind: string; detail: string }): Choice | undefined {
    const unit = (key: string, wanted: string): Choice | undefined => {
      const names = QUANTITIES.filter((one) => one.key === key).flatMap((one) => this.of(one));
      if (names.length === 0 || names.every((name) => this.unit(name) === wanted)) return undefined;
      return { ...this.choice, unit: { ...this.choice.unit, ...Object.fromEntries(names.map((name) => [name, wanted])) } };
    };
    const frames = (wanted: Record<string, string>): Choice | undefined => {
      const changed = Object.entries(wanted).filter(([key, frame]) => QUANTITIES.some((one) => one.key === key && this.of(one).length > 0 && this.frame(one) !== frame));
      return changed.length === 0 ? undefined : { ...this.choice, frame: { ...this.choice.frame, ...Object.fromEntries(changed) } };
    };
    switch (finding.kind) {
      case "rates_in_degrees": return unit("rates", "deg/s");
      case "angles_in_degrees": return unit("attitude", "deg");
      case "accel_in_g": return unit("accel", "g");
      case "body_axes_flu": return frames({ rates: "flu", accel: "flu" });
      case "world_axes_enu": {
        const frame = finding.detail.includes("north-west-up") ? "nwu" : "enu";
        return frames({ velocity: frame, position: frame });
      }
      case "swapped_motors": {
        const outputs = QUANTITIES.filter((one) => one.key === "duty").flatMap((one) => this.of(one));
        const order = orderIn(finding.detail, outputs.length);
        if (!order || order.length !== outputs.length) return undefined;
        return { ...this.choice, meaning: { ...this.choice.meaning, ...Object.fromEntries(order.map((output, k) => [outputs[output - 1] ?? "", `duty_${k + 1}`])) } };
      }
      default: return undefined;
    }
  }
}

/** Fields that a finding is about. */
export function placesOfFinding(table: Table, finding: { kind: string; detail: string }): string[] {
  const first = (key: string) => QUANTITIES.filter((one) => one.key === key).flatMap((one) => table.of(one)).slice(0, 1).map((name) => `column ${name}`);
  switch (finding.kind) {
    case "rates_in_degrees": case "body_axes_flu": return first("rates");
    case "angles_in_degrees": return first("attitude");
    case "accel_in_g": case "upside_down_axes": return first("accel");
    case "world_axes_enu": return first("velocity");
    case "swapped_axes": return first(/^the (velocity|position)/.exec(finding.detail)?.[1] ?? "rates");
    case "time_scale": return [table.columns(TIME).length > 0 ? "clock" : "rate"];
    case "swapped_motors": case "rotor_count": case "no_flight": return table.columns("duty_1").length > 0 ? ["duty"] : [];
    default: return [];
  }
}

/** A number as typed, with a point or a comma. */
export function numberIn(typed: string): number | undefined {
  const value = Number(typed.trim().replace(",", "."));
  return typed.trim() !== "" && Number.isFinite(value) ? value : undefined;
}

/** TOML reads the escapes of JSON; what JSON leaves as it is and TOML does not take is DEL. */
const text = (value: string) => JSON.stringify(value).replaceAll("\u007f", "\\u007f");
const float = (value: number) => (Number.isInteger(value) ? value.toFixed(1) : String(value));

/** A refusal of the import because the columns have names of their own: what was found, without the advice for the command line. */
export const isOfAnotherProgram = (refusal: string) => refusal.includes("a table of another program");
export const refusalWithoutCommand = (refusal: string) =>
  refusal
    .replace(/(; | \()a table of another program: `rotortwin log map FILE` drafts a mapping for it\)?/, ". It is a table of another program: say in step 2 what its columns are.")
    .replace(/; set the unit of '\w+' in a mapping$/, "");
/** Files that may hold such a table. */
export const mayBeTable = (file: string) => /\.(csv|tsv|txt|log)$/i.test(file);
