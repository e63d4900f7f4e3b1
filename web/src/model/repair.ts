/**
 * Re-importing a log: choices of axes, units and order, and the corresponding mapping (TOML) for the server.
 *
 * Mappings of autopilots start from the built-in rows (config/log-mappings), so that a choice changes only what it is about.
 */

/** Kinds of source with a mapping. */
export type SourceName = "px4-ulog" | "ardupilot-dataflash" | "crazyflie-usdlog" | "blackbox" | "mavlink-tlog" | "ros2" | "run-mcap" | "canonical";

/** `(axis of the file, sign)` of each of our axes. */
export type Axes = readonly [Signed, Signed, Signed];
type Signed = readonly [0 | 1 | 2, 1 | -1];

export const AS_IS: Axes = [[0, 1], [1, 1], [2, 1]];
/** Forward-left-up into forward-right-down, and north-west-up into north-east-down. */
export const UP_LEFT: Axes = [[0, 1], [1, -1], [2, -1]];
const FROM_ENU: Axes = [[1, 1], [0, 1], [2, -1]];

interface Group {
  key: "rates" | "accel" | "attitude" | "velocity" | "position";
  title: string;
  columns: readonly [string, string, string];
  units: readonly (readonly [string, string])[];
  /** Common axis conventions, by name. */
  axes: readonly (readonly [string, Axes])[];
}
const BODY = [["forward, right, down: as expected", AS_IS], ["forward, left, up", UP_LEFT], ["x and y exchanged", [[1, 1], [0, 1], [2, 1]]], ["x and z exchanged", [[2, 1], [1, 1], [0, 1]]], ["y and z exchanged", [[0, 1], [2, 1], [1, 1]]], ["z upside down", [[0, 1], [1, 1], [2, -1]]]] as const;
const WORLD = [["north, east, down: as expected", AS_IS], ["east, north, up", FROM_ENU], ["north, west, up", UP_LEFT], ["north and east exchanged", [[1, 1], [0, 1], [2, 1]]], ["up instead of down", [[0, 1], [1, 1], [2, -1]]]] as const;
export const GROUPS: readonly Group[] = [
  { key: "rates", title: "Body rates", columns: ["roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s"], units: [["rad/s", "rad/s"], ["deg/s", "deg/s"]], axes: BODY },
  { key: "accel", title: "Accelerometer", columns: ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"], units: [["m/s2", "m/s²"], ["g", "g"], ["mg", "mg"]], axes: BODY },
  { key: "attitude", title: "Roll, pitch, yaw", columns: ["roll_rad", "pitch_rad", "yaw_rad"], units: [["rad", "rad"], ["deg", "degrees"]], axes: [["as expected", AS_IS], ["of axes forward, left, up", UP_LEFT], ["roll and pitch exchanged", [[1, 1], [0, 1], [2, 1]]]] },
  { key: "velocity", title: "Velocity", columns: ["velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"], units: [["m/s", "m/s"], ["cm/s", "cm/s"], ["mm/s", "mm/s"], ["km/h", "km/h"]], axes: WORLD },
  { key: "position", title: "Position", columns: ["position_north_m", "position_east_m", "position_down_m"], units: [["m", "m"], ["cm", "cm"], ["mm", "mm"], ["ft", "ft"]], axes: WORLD },
];
export type GroupKey = Group["key"];

export interface Choice {
  axes: Partial<Record<GroupKey, Axes>>;
  units: Partial<Record<GroupKey, string>>;
  /** For each rotor of the vehicle, the log's output, from 1. */
  order?: readonly number[] | undefined;
  /** Seconds per unit of the time stamps; CSV and Parquet only. */
  time?: number | undefined;
}

export const sameAxes = (a: Axes, b: Axes) => a.every(([axis, sign], k) => b[k]?.[0] === axis && b[k]?.[1] === sign);
/** `(y, x, −z)`. */
export const axesText = (axes: Axes) => `(${axes.map(([axis, sign]) => `${sign < 0 ? "−" : ""}${"xyz"[axis]}`).join(", ")})`;
/** Axes from a message of the server, such as "the body rates fit the attitude as (y, x, −z)". */
export function axesIn(sentence: string): Axes | undefined {
  const found = /as \((−?[xyz]), (−?[xyz]), (−?[xyz])\)/.exec(sentence)?.slice(1);
  if (!found || new Set(found.map((one) => one.at(-1))).size !== 3) return undefined;
  return found.map((one) => ["xyz".indexOf(one.at(-1) ?? "x"), one.startsWith("−") ? -1 : 1] as unknown as Signed) as unknown as Axes;
}

/** Sources by the kinds that an import reports. */
const SOURCE_OF_KIND: Readonly<Record<string, SourceName>> = {
  px4_ulog: "px4-ulog", ardupilot_dataflash: "ardupilot-dataflash", ardupilot_dataflash_text: "ardupilot-dataflash", crazyflie_usdlog: "crazyflie-usdlog",
  blackbox: "blackbox", mavlink_tlog: "mavlink-tlog", ros2_bag: "ros2", run_mcap: "run-mcap", csv: "canonical", parquet: "canonical",
};
const SOURCE_OF_ENDING: Readonly<Record<string, SourceName>> = {
  ulg: "px4-ulog", bin: "ardupilot-dataflash", log: "ardupilot-dataflash", bbl: "blackbox", bfl: "blackbox", txt: "blackbox", tlog: "mavlink-tlog", mcap: "ros2", db3: "ros2",
  csv: "canonical", tsv: "canonical", parquet: "canonical",
};

/** Kind of source: what the import found in the file, or, where it refused that, what the name says. */
export function sourceOf(kind: string | undefined, fileName: string): SourceName {
  const ending = /\.([^.]+)$/.exec(fileName)?.[1]?.toLowerCase() ?? "";
  return SOURCE_OF_KIND[kind ?? ""] ?? SOURCE_OF_ENDING[ending] ?? "crazyflie-usdlog";
}

export interface Finding {
  kind: string;
  detail: string;
}

/** Corrections suggested by the findings and refusals of an import; none if they suggest nothing. */
export function suggestionOf(findings: readonly Finding[], rotors = 0): Choice {
  const choice: Choice = { axes: {}, units: {} };
  for (const { kind, detail } of findings) {
    const axes = axesIn(detail);
    if (kind === "swapped_axes" && axes) {
      const key = detail.startsWith("the velocity") ? "velocity" : detail.startsWith("the position") ? "position" : "rates";
      choice.axes[key] = axes;
    } else if (kind === "body_axes_flu") {
      choice.axes.rates = UP_LEFT;
      choice.axes.accel = UP_LEFT;
    } else if (kind === "upside_down_axes") choice.axes.accel = [[0, 1], [1, 1], [2, -1]];
    else if (kind === "world_axes_enu") {
      const world = detail.includes("north-west-up") ? UP_LEFT : FROM_ENU;
      choice.axes.velocity = world;
      choice.axes.position = world;
    } else if (kind === "rates_in_degrees") choice.units.rates = "deg/s";
    else if (kind === "angles_in_degrees") choice.units.attitude = "deg";
    else if (kind === "accel_in_g") choice.units.accel = "g";
    else if (kind === "time_scale") {
      const factor = Number(/time stamps are ([\d.]+) times too short/.exec(detail)?.[1]);
      if (factor > 0) choice.time = factor;
    } else if (kind === "swapped_motors") choice.order = orderIn(detail, rotors);
  }
  return choice;
}

/** Whether a comparison refuses a log for the order of its motors. */
export const isOfMotors = (refusal: string) => /swapped motors: .*drives rotor/.test(refusal);

/** Such a refusal without what is for the command line: the page reads the log again by a click. */
export const motorsWithoutCommand = (refusal: string) =>
  isOfMotors(refusal) ? refusal.replace(/; `@order:[^;]*/, "").replace(/; fix it \(a mapping for [^)]*\) and try again$/, ". Step 2 reads it again in the order that fits.") : refusal;

/** Motor order from "duty_1 drives rotor 3, duty_3 drives rotor 1"; the others stay. */
export function orderIn(detail: string, rotors = 0): number[] | undefined {
  const moved = [...detail.matchAll(/duty_(\d+) drives rotor (\d+)/g)].map((one) => [Number(one[1]), Number(one[2])] as const);
  if (moved.length === 0) return undefined;
  const count = Math.max(rotors, ...moved.flat());
  const order = Array.from({ length: count }, (_, k) => k + 1);
  for (const [output, rotor] of moved) order[rotor - 1] = output;
  return order;
}

/** A refusal of the import names the unit, too: "the accelerometer is in g", "degrees?". */
export function suggestionOfRefusal(sentence: string): Choice {
  if (/accelerometer is in g/.test(sentence)) return { axes: {}, units: { accel: "g" } };
  if (/pitch in radians/.test(sentence)) return { axes: {}, units: { attitude: "deg" } };
  return { axes: {}, units: {} };
}

export const isChosen = (choice: Choice) =>
  Object.values(choice.axes).some((axes) => !sameAxes(axes, AS_IS)) || Object.keys(choice.units).length > 0 || choice.order !== undefined || choice.time !== undefined;

/** One `[[column]]` of a mapping: its lines, and the values that the choices need. */
interface Row {
  lines: string[];
  to: string;
  from: string;
  frame: string | undefined;
}
function rowsOf(mapping: string): Row[] {
  return mapping.split(/^\[\[column\]\].*$/m).slice(1).map((block) => {
    const lines = block.split("\n").map((line) => line.trim()).filter((line) => line !== "" && !line.startsWith("#"));
    const value = (key: string) => lines.find((line) => line.startsWith(`${key} =`))?.replace(/^\w+ = "([^"]*)".*$/, "$1");
    return { lines, to: value("to") ?? "", from: value("from") ?? "", frame: value("frame") };
  });
}
const set = (lines: readonly string[], key: string, text: string) => [...lines.filter((line) => !line.startsWith(`${key} =`)), `${key} = ${text}`];
const without = (lines: readonly string[], ...keys: string[]) => lines.filter((line) => !keys.some((key) => line.startsWith(`${key} =`)));

/** The rows changed by a choice; `builtIn` is the mapping of the source. Undefined: nothing was chosen. */
export function mappingOf(source: SourceName, choice: Choice, builtIn: string, rotors: number): string | undefined {
  if (!isChosen(choice)) return undefined;
  const rows = source === "canonical" ? canonicalRows(rotors) : rowsOf(builtIn);
  const changed: string[][] = [];
  for (const group of GROUPS) {
    const axes = choice.axes[group.key];
    const unit = choice.units[group.key];
    if ((axes === undefined || sameAxes(axes, AS_IS)) && unit === undefined) continue;
    for (const row of rows) {
      const own = row.to === group.key;
      const single = group.columns.indexOf(row.to);
      if (!own && single < 0) continue;
      const lines = unit === undefined ? row.lines : set(row.lines, "unit", JSON.stringify(unit));
      if (axes === undefined || sameAxes(axes, AS_IS) || row.frame === "geodetic") changed.push(lines);
      else if (own) changed.push(...turned(group, lines, row, axes));
    }
  }
  if (choice.order) {
    for (const row of rows.filter((one) => one.to === "duty")) {
      changed.push(source === "canonical" ? set(row.lines, "from", JSON.stringify(`file:${choice.order.map((number) => `duty_${number}`).join(",")}`)) : set(row.lines, "order", JSON.stringify(choice.order)));
    }
  }
  if (choice.time !== undefined && source === "canonical") changed.push(['to = "time_s"', 'from = "file:time_s"', `factor = ${choice.time}`]);
  if (changed.length === 0) return undefined;
  return [`source = "${source}"`, "", ...changed.flatMap((lines) => ["[[column]]", ...lines, ""])].join("\n");
}

/** A vector row split into three single-column rows with other axes: first the frame of the row, then the choice. */
function turned(group: Group, lines: readonly string[], row: Row, axes: Axes): string[][] {
  const [topic = "", fields = ""] = row.from.split(/:(.*)/s);
  const names = fields.includes("[]") ? [0, 1, 2].map((k) => fields.replace("[]", `[${k}]`)) : fields.split(",").map((field) => field.trim());
  const frame = row.frame === "flu" || row.frame === "nwu" || row.frame === "nwu-flu" ? UP_LEFT : row.frame === "enu" ? FROM_ENU : AS_IS;
  const rest = without(lines, "to", "from", "frame", "factor");
  const before = Number(/^factor = (\S+)/.exec(lines.find((line) => line.startsWith("factor =")) ?? "")?.[1] ?? 1);
  return group.columns.map((column, k) => {
    const [ours, sign] = axes[k] ?? [0, 1];
    const [theirs, turn] = frame[ours];
    const factor = sign * turn * before;
    return [`to = "${column}"`, `from = ${JSON.stringify(`${topic}:${names[theirs] ?? ""}`)}`, ...rest, ...(factor === 1 ? [] : [`factor = ${factor.toFixed(1)}`])];
  });
}

function canonicalRows(rotors: number): Row[] {
  const row = (to: string, from: string, unit: string): Row => ({ to, from, frame: undefined, lines: [`to = "${to}"`, `from = "${from}"`, `unit = "${unit}"`] });
  return [
    ...GROUPS.map((group) => row(group.key, `file:${group.columns.join(",")}`, group.units[0]?.[0] ?? "1")),
    row("duty", `file:${Array.from({ length: rotors }, (_, k) => `duty_${k + 1}`).join(",")}`, "1"),
  ];
}

/** Parses an order as typed: "3, 2, 1, 4"; undefined if invalid. */
export function orderOf(text: string): number[] | undefined {
  const numbers = text.split(/[\s,;]+/).filter(Boolean).map(Number);
  const good = numbers.length > 0 && numbers.every((one) => Number.isInteger(one) && one >= 1) && new Set(numbers).size === numbers.length;
  return good ? numbers : undefined;
}

/** Advice if no choice helps; undefined if one does. */
export function adviceFor(kind: string, source: SourceName): string | undefined {
  const autopilot = source !== "canonical";
  const words: Record<string, string> = {
    no_flight: "Nothing can be repaired: no part of this log is a flight. Choose a log with one, motors above idle for 10 s or more.",
    one_column: "Nothing can be repaired: log at least attitude or body rates, the accelerometer, and the motor outputs beside the time, and fly again.",
    rotor_count: "Choose the vehicle that flew in step 3, or name the outputs that drive its rotors in “order of the motors”: the first number is the output of rotor 1.",
    scale_mismatch: "One unit is wrong: the finding names the pair whose gain is not 1. Choose the unit of one of the two below; if the finding is then gone, that was it.",
    inconsistent: "These columns do not belong together: they come from different flights, clocks or vehicles. Export them from one log, without shifting one against the other.",
  };
  if (kind === "time_scale" && autopilot) return "A mapping cannot change the clock of an autopilot's log. Convert it with “rotortwin log import”, multiply time_s of the CSV by the factor of the finding, and drop that file here.";
  return words[kind];
}
