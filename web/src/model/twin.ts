/** Answers on comparisons, diagnoses, models and imports, by their names on the page, and their texts. The server's document declares them. */
import type { Schemas } from "../api/client";
import type { Narrowed } from "../api/narrowed";
import { short } from "../format";
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

/** Channels of which a sentence names the errors; of the others it says how many there are. */
const NAMED = 4;

/** The channels that contradict a model, worst first: `roll moment (mx): error 1.09 × noise, but it lasts (means over 0.25 s: chi²/N 1.52)`. */
export function failuresOf(model: ModelOnLog): string {
  const failing = model.channels.filter((one) => one.verdict === "fails").sort((a, b) => (b.low_frequency ?? 0) - (a.low_frequency ?? 0));
  const parts = failing.slice(0, NAMED).map((one) => {
    const ratio = (one.smoothed_rms ?? NaN) / (one.smoothed_noise ?? NaN);
    // An error as small as the noise fails if it persists, which noise does not.
    const lasts = ratio < 1.1 && (one.low_frequency ?? 0) > 1 ? `, but it lasts (means over 0.25 s: chi²/N ${short(one.low_frequency)})` : "";
    const depends = one.conditions[0];
    return `${channelTitle(one.channel)}: error ${short(ratio)} × noise${lasts}${depends && depends.explained > 0.3 ? `, ${(100 * depends.explained).toFixed(0)} % of it explained by ${depends.title}` : ""}`;
  });
  return `${parts.join("; ")}${failing.length > NAMED ? `; and ${failing.length - NAMED} more` : ""}`;
}

/** What a comparison says of the last model on a log. */
export function comparisonSentence(log: LogComparison): string {
  const model = log.models.at(-1);
  if (!model) return "";
  const tested = model.channels.filter((one) => one.verdict !== "not-testable");
  if (tested.length === 0) return `Nothing of ${model.model} can be tested with this log.`;
  if (model.agrees) return `${model.model} agrees with this flight: ${tested.length} channels are at their noise (chi²/N ${short(model.chi2)}).`;
  return `${model.model} fails in ${failuresOf(model)}.`;
}

/**
 * What a comparison of the diagnosed model with the diagnosed flights still sees, although the diagnosis finds nothing to add. The two ask
 * different questions: whether a channel is at its noise, and whether an effect of the catalogue explains what is not. Undefined: nothing,
 * or the comparison is of another model or of other flights.
 */
export function remainderOf(found: Diagnosis, comparison: Comparison | undefined): string | undefined {
  if (found.verdict.kind !== "agrees" || !comparison) return undefined;
  const place = comparison.models.findIndex((one) => one.hash === found.model.hash);
  const parts = comparison.logs.flatMap((log) => {
    const model = found.logs.includes(log.log.name) ? log.models[place] : undefined;
    const failures = model ? failuresOf(model) : "";
    return failures === "" ? [] : [found.logs.length > 1 ? `in ${log.log.name} ${failures}` : failures];
  });
  return parts.length === 0 ? undefined : parts.join("; ");
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
