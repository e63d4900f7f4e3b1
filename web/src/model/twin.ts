/** Types of the answers on comparisons, diagnoses, models and imports, as far as the page shows them, and their texts. */
import type { Values } from "../plots/series";

export interface ImportResult {
  headline: string;
  account: string;
  source: { kind: string };
  report: {
    rows: number;
    sample_rate_hz: number;
    gaps: { start_s: number; end_s: number }[];
    streams: { name: string; samples: number; sample_rate_hz: number; resampling: string }[];
    unused_columns: { column: string; reason: string }[];
    unknown_columns: string[];
    missing_cells: { column: string; cells: number }[];
    missing: { columns: string[]; rules_out: string }[];
    delays: { signal: string; against: string; delay_s: number; uncertainty_s: number; correlation: number; applied: boolean }[];
    findings: { kind: string; detail: string }[];
    conversions: string[];
    notes: string[];
  };
}

export interface Bin {
  at: number;
  mean: number;
  band_95: number;
  chi2: number;
  blocks: number;
}
export interface ChannelResult {
  channel: string;
  unit: string;
  verdict: "agrees" | "fails" | "not-testable";
  smoothed_rms: number | null;
  smoothed_noise: number | null;
  chi2: number | null;
  low_frequency: number | null;
  conditions: { condition: string; title: string; unit: string; explained: number; bins: Bin[] }[];
  strip: (number | null)[];
  ljung_box: { p_value: number | null } | null;
  inputs: { input: string; correlation: number | null; lag_s: number; band_99: number | null }[];
}
export interface QuantityError {
  quantity: string;
  unit: string;
  error: number | null;
  noise: number | null;
}
export interface ModelOnLog {
  model: string;
  agrees: boolean;
  chi2: number | null;
  channels: ChannelResult[];
  errors: QuantityError[];
  open_loop: { horizon_s: number; starts: number; position_m: number | null; velocity_m_s: number | null; attitude_rad: number | null }[];
  worst: { start_s: number; end_s: number; channel: string; error: number; unit: string; deviations: number; conditions: [string, number, string][] }[];
  nuisances: { rotor_bias_n: number[]; charge_at_start: number; wind_m_s?: [number, number] };
}
export interface LogComparison {
  log: { name: string; hash: string };
  duration_s: number;
  rate_hz: number;
  notes: string[];
  noise: Record<"position_m" | "velocity_m_s" | "attitude_rad" | "rates_rad_s" | "accel_m_s2" | "voltage_v", number | null>;
  excluded: { start_s: number; end_s: number }[];
  models: ModelOnLog[];
}
export interface Comparison {
  tool: string;
  verdict: string;
  models: { label: string; hash: string; effects: string[] }[];
  logs: LogComparison[];
}

/** Means and extremes per bucket. */
export interface Buckets {
  mean: Values;
  low: Values;
  high: Values;
}
/** One channel of a comparison over time. */
export interface Series {
  channel: string;
  unit: string;
  start_s: number;
  end_s: number;
  bucket_s: number;
  time_s: number[];
  measured: Buckets;
  models: { label: string; predicted: Buckets; residual: Buckets }[];
  noise: { sample: number; mean: number };
}

export interface Parameter {
  name: string;
  symbol: string;
  unit: string;
  value: number;
  interval_95: number;
  plausible: boolean;
}
export interface Rival {
  effect: string;
  rotor?: number | null;
  label: string;
  evidence_gap: number;
  reason: string;
}
export interface Finding {
  instance: { effect: string; rotor?: number | null };
  label: string;
  class: string;
  equation: string;
  parameters: Parameter[];
  ln_bayes_factor: number;
  posterior: number;
  channels: string[];
  also_compatible: Rival[];
  lost: Rival[];
  onset_s: number | null;
  reason: string;
  picture?: { channel: string; unit: string; bins: { at: number; before: number; after: number; band_95: number; blocks: number }[] } | null;
}
export interface Proposal {
  document: unknown;
  terms: { acts: string[]; parameter: string; factor: number; deviation: number; unit: string; correlation: number; held_out_share: number }[];
  correlates: { channel: string; regressor: string; correlation: number }[];
}
export interface Unseen {
  label: string;
  parameter: string;
  unit: string;
  plausible_size: number;
  minimum_size: number | null;
  excited_by: string;
}
export interface Unconsidered {
  label: string;
  columns: string[];
  setting: string | null;
  reason: string;
}
/** The effect that is the error of a constant, with the values that the flight wants. */
export interface Correction {
  effect: string;
  rotor?: number;
  parameters: Record<string, number>;
  deviations: Record<string, number>;
}
export interface Diagnosis {
  model: { name: string; hash: string };
  verdict: { kind: "agrees" | "missing" | "partly-missing" | "cannot-tell" | "calibrate-first" | "outside-catalogue" | "log-fault" | "nothing-testable"; effects?: string[]; group?: string[] };
  sentence: string;
  effects: Finding[];
  sensor_or_timing: Finding[];
  ranking: { label: string; parameters: { plausible: boolean }[]; ln_bayes_factor: number; held_out_chi2_change: number }[];
  not_testable: Unseen[];
  not_considered: Unconsidered[];
  calibrate: { key: string; name: string; unit: string; value: number; low: number; high: number; wanted: number; wanted_interval_95: number; ln_bayes_factor: number; blocking: boolean; how: string; better: string; correction?: Correction }[];
  trim?: {
    sentence: string;
    thrust_change: number[];
    spread: [number, number];
    smallest_loss: number | null;
    with_more: { flights: number; smallest_loss?: number | null }[];
    vibration?: { sentence: string } | null;
    no_vibration?: string | null;
  } | null;
  detectable: Unseen[];
  goodness: { explained_share: number | null; unexplained: string[] };
  held_out: { quantity: string; unit: string; before: number; after: number; change_deviation: number; noise: number }[];
  proposal: Proposal | null;
  /** Steady wind of each flight, where they have no explanation in one. */
  winds?: { log: string; distinguished: boolean; parameters: { symbol: string; unit: string; value: number; interval_95: number }[] }[];
  logs: string[];
  notes: string[];
  threshold: number;
}

/** The course of an improvement, version by version. */
export interface Improvement {
  tool: string;
  end: string;
  reason: string;
  rows: {
    version: string;
    hash: string;
    added: string | null;
    parameters: { name: string; symbol: string; unit: string; value: number; interval_95: number }[];
    ln_bayes_factor: number | null;
    /** The truth, where it is known. */
    oracle: boolean;
    logs: { log: string; held_out: boolean; agrees: boolean; errors: QuantityError[]; open_loop: { horizon_s: number; position_m: number | null }[] }[];
    remarks: string[];
  }[];
  diagnosis: Diagnosis | null;
  next_flight: string | null;
}

export interface Version {
  version: number;
  label: string;
  hash: string;
  parent: number | null;
  note: string;
  changed: string[];
  effects: {
    effect: string;
    label: string;
    source: string;
    parameters: { name: string; value: number; deviation: number | null }[];
    ln_bayes_factor: number | null;
  }[];
  made_ms: number;
}
export interface History {
  name: string;
  begun: boolean;
  vehicle: string;
  branches: { name: string; version: number; hash: string }[];
  versions: Version[];
}

/** Effects that could not be considered, grouped by reason. */
export function togetherByReason(all: readonly Unconsidered[]): { labels: string[]; reason: string; columns: string[]; setting: string | null }[] {
  const rows: { labels: string[]; reason: string; columns: string[]; setting: string | null }[] = [];
  for (const one of all) {
    const row = rows.find((other) => other.reason === one.reason && other.setting === one.setting && other.columns.join() === one.columns.join());
    if (row) row.labels.push(one.label);
    else rows.push({ labels: [one.label], reason: one.reason, columns: one.columns, setting: one.setting });
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
    at = version.parent;
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
export function evidenceWords(ln: number): string {
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
