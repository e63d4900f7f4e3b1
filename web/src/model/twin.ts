/** Answers on comparisons, diagnoses, models and imports, by their names on the page, and their texts. The server's document declares them. */
import type { Schemas } from "../api/client";
import type { Narrowed } from "../api/narrowed";
import type { Values } from "../plots/series";

export type ImportResult = Schemas["ImportAccount"];

export type Bin = Schemas["Bin"];
export type ChannelResult = Schemas["ChannelResult"];
export type QuantityError = Schemas["GroupError"];
/** Conditions: title, value, unit. */
export type WorstMoment = Narrowed<Schemas["WorstMoment"], { conditions: [string, number | null, string][] }>;
export type ModelOnLog = Narrowed<Schemas["ModelOnLog"], { worst: WorstMoment[] }>;
export type LogComparison = Narrowed<Schemas["LogComparison"], { models: ModelOnLog[] }>;
export type Comparison = Narrowed<Schemas["Comparison"], { logs: LogComparison[] }>;

/** Means and extremes per bucket. */
export type Buckets = Schemas["Buckets"];
/** One channel of a comparison over time; of which log, and of how many rows, a report does not repeat. */
export type Series = Omit<Schemas["ChannelSeries"], "log" | "name" | "source_rows">;

export type Parameter = Schemas["FittedParameter"];
export type Rival = Schemas["RivalEffect"];
export type Finding = Schemas["Finding"];
export type Proposal = Schemas["Proposal"];
export type Unseen = Schemas["NotTestable"];
export type Unconsidered = Schemas["NotConsidered"];
/** The effect that is the error of a constant, with the values estimated from the flight. */
export type Correction = Schemas["ConstantCorrection"];
export type Diagnosis = Schemas["Diagnosis"];

/** The course of an improvement, version by version. */
export type ImprovementRow = Narrowed<Schemas["ImprovementRow"], { parameters: Parameter[] }>;
export type Improvement = Narrowed<Schemas["Improvement"], { rows: ImprovementRow[] }>;

export type Version = Schemas["VersionView"];
export type History = Schemas["ModelHistory"];

/** Effects that could not be considered, grouped by reason. */
export function togetherByReason(all: readonly Unconsidered[]): { labels: string[]; reason: string; columns: string[]; setting: string | null }[] {
  const rows: { labels: string[]; reason: string; columns: string[]; setting: string | null }[] = [];
  for (const one of all) {
    const row = rows.find((other) => other.reason === one.reason && other.setting === (one.setting ?? null) && other.columns.join() === one.columns.join());
    if (row) row.labels.push(one.label);
    else rows.push({ labels: [one.label], reason: one.reason, columns: one.columns, setting: one.setting ?? null });
  }
  return rows;
}

const CHANNEL_WORDS: Record<string, string> = {
  fx: "forward specific force", fy: "sideways specific force", fz: "vertical specific force",
  mx: "roll moment", my: "pitch moment", mz: "yaw moment",
  kv_north: "velocity innovation north", kv_east: "velocity innovation east", kv_down: "velocity innovation down",
  ka_roll: "attitude-rate innovation roll", ka_pitch: "attitude-rate innovation pitch", ka_yaw: "attitude-rate innovation yaw",
  kp_north: "position innovation north", kp_east: "position innovation east", kp_down: "position innovation down",
  v: "battery voltage",
};

const CHANNEL_STRIPS: Record<string, string> = {
  fx: "forward force (fx)", fy: "sideways force (fy)", fz: "vertical force (fz)",
  mx: "roll moment (mx)", my: "pitch moment (my)", mz: "yaw moment (mz)",
  kv_north: "velocity north", kv_east: "velocity east", kv_down: "velocity down",
  ka_roll: "attitude rate roll", ka_pitch: "attitude rate pitch", ka_yaw: "attitude rate yaw",
  kp_north: "position north", kp_east: "position east", kp_down: "position down",
  v: "battery voltage",
};

/** [`channelTitle`] shortened for the rows of a heat strip. */
export const channelStrip = (channel: string) => CHANNEL_STRIPS[channel] ?? channel;

/** `forward specific force (fx)`. */
export const channelTitle = (channel: string) => (CHANNEL_WORDS[channel] ? `${CHANNEL_WORDS[channel]} (${channel})` : channel);

/** The versions from the first one to `head`, in order. */
export function lineTo(history: History, head: number): Version[] {
  const line: Version[] = [];
  let at: number | null = head;
  while (at !== null && line.length <= history.versions.length) {
    const version = history.versions.find((one) => one.version === at);
    if (!version) break;
    line.unshift(version);
    at = version.parent ?? null;
  }
  return line;
}

/** Corrections of several constants, each effect once: a parameter has the value of the correction that is about it. */
export function together(corrections: readonly Correction[]): Correction[] {
  const found = new Map<string, Correction>();
  for (const one of corrections) {
    const key = `${one.effect}#${one.rotor ?? ""}`;
    const there = found.get(key);
    if (!there) {
      found.set(key, { ...one, parameters: { ...one.parameters }, deviations: { ...one.deviations } });
      continue;
    }
    for (const [name, deviation] of Object.entries(one.deviations)) {
      if (deviation <= 0) continue;
      there.parameters[name] = one.parameters[name] ?? 0;
      there.deviations[name] = deviation;
    }
  }
  return [...found.values()];
}

/** Flight conditions of a log over time, in buckets. */
export type Conditions = Pick<Schemas["ConditionSeries"], "bucket_s" | "time_s"> & { items: readonly { name: string; mean: Values }[] };

/** A bin of a condition, and between which of its values it lies: halfway to its neighbours, and without end at both ends. */
export interface Part {
  bin: Bin;
  low: number;
  high: number;
}
export function partAt(bins: readonly Bin[], place: number): Part | undefined {
  const bin = bins[place];
  if (!bin) return undefined;
  const halfway = (other: Bin | undefined, end: number) => (other ? (bin.at + other.at) / 2 : end);
  return { bin, low: halfway(bins[place - 1], -Infinity), high: halfway(bins[place + 1], Infinity) };
}

/** When a condition lies within a part, s: neighbouring buckets joined. */
export function timesWithin(conditions: Conditions, name: string, part: Part): [number, number][] {
  const mean = conditions.items.find((one) => one.name === name)?.mean ?? [];
  const times: [number, number][] = [];
  conditions.time_s.forEach((middle, k) => {
    const value = mean[k];
    if (typeof value !== "number" || value < part.low || value > part.high) return;
    const [from, to] = [middle - conditions.bucket_s / 2, middle + conditions.bucket_s / 2];
    const last = times.at(-1);
    if (last && from - last[1] < 0.01 * conditions.bucket_s) last[1] = to;
    else times.push([from, to]);
  });
  return times;
}

/** A key that is the same for the same inputs: repeating a request returns the existing job. */
export function keyOf(value: unknown): string {
  // FNV-1a, twice with different offsets: 64 bits distinguish the few jobs of one user.
  const text = JSON.stringify(value);
  return [0x811c9dc5, 0x1234567].map((start) => {
    let hash = start;
    for (let k = 0; k < text.length; k += 1) hash = Math.imul(hash ^ text.charCodeAt(k), 0x01000193) >>> 0;
    return hash.toString(16).padStart(8, "0");
  }).join("");
}

/** A ln Bayes factor in words. */
export function evidenceWords(ln: number | null | undefined): string {
  if (typeof ln !== "number") return "not computed";
  if (ln > 10) return "decisive";
  if (ln > 5) return "strong";
  return ln > 2 ? "moderate" : "weak";
}

/** The channel with the largest error. */
export function worstChannel(model: ModelOnLog): string {
  let worst = model.channels[0];
  for (const one of model.channels) if ((one.low_frequency ?? 0) > (worst?.low_frequency ?? 0)) worst = one;
  return worst?.channel ?? "fx";
}

const FINDING_WORDS: Record<string, string> = {
  upside_down_axes: "Axes upside down", accel_in_g: "Accelerometer in g", angles_in_degrees: "Angles in degrees", rates_in_degrees: "Rates in degrees per second",
  body_axes_flu: "Body axes forward-left-up", world_axes_enu: "World axes east-north-up", time_scale: "Time stamps off by a factor", stuck: "Stuck column",
  saturated: "Saturated column", one_column: "Too few columns", all_missing: "Empty column", no_flight: "No flight", swapped_motors: "Swapped motors",
  swapped_axes: "Swapped axes", rotor_count: "Rotor count", scale_mismatch: "Scales that do not fit", inconsistent: "Columns that do not fit",
};
export const findingTitle = (kind: string) => FINDING_WORDS[kind] ?? kind.replaceAll("_", " ");
/** A finding that rules out any comparison with a model. */
export const findingBlocks = (kind: string) => !["stuck", "saturated", "all_missing"].includes(kind);
