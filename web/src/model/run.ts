/** A run's data on the page: its summary, and its samples, live and afterwards. */
import { type Schemas, ask } from "../api/client";
import { FLOWN_AGAIN_S, type LiveMessage } from "../api/live";
import type { Track } from "../replay/motion";

export type Score = Schemas["DetectorScore"];
export type Interval = Schemas["FlightInterval"];
/** A detector of the user's own that judged the run after its flight: one score for each interval. */
export type OwnDetector = Schemas["OwnDetector"];
/** `summary.json`. A seed beyond 2^53 is a text, as [`parseExact`] reads it. */
export type Summary = Omit<Schemas["RunSummary"], "seed"> & { seed: number | string };

const HEALTHY = 0;
const UNKNOWN = -1;
/** Share of windows from which a verdict counts as good. */
const GOOD_SHARE = 0.9;

/** Rates a detector in an interval as good, fair or poor; empty if it gave no verdict. */
export function kindOfScore(interval: Interval, score: Score): "good" | "warn" | "bad" | "" {
  if (typeof score.share_right !== "number") return "";
  const healthy = interval.fault_label === HEALTHY;
  if (healthy) {
    // An alarm of the interval before that goes on is no event of this one.
    const goesOn = score.other_rotor > 0 && score.share_right < GOOD_SHARE;
    if (goesOn && score.share_right === 0) return "bad";
    return score.false_alarm_events === 0 && !goesOn ? "good" : "warn";
  }
  if (typeof score.isolated_after_s !== "number") return "bad";
  const held = score.verdict_at_end === interval.expected_verdict || score.right_at_end === true;
  return held && score.share_right >= GOOD_SHARE ? "good" : "warn";
}

/** The other verdicts of the windows: "3 healthy, 12 calibrating". */
export function otherwise(interval: Interval, score: Score): string {
  const healthy = interval.fault_label === HEALTHY;
  const counts: [number, string][] = [
    [healthy ? 0 : score.healthy, "healthy"],
    [interval.expected_verdict === UNKNOWN ? 0 : score.unknown, "unknown"],
    [score.other_rotor, healthy ? "named a rotor" : "other rotor"],
    [score.not_ready, "no verdict yet"],
  ];
  return counts.filter(([count]) => count > 0).map(([count, what]) => `${count.toLocaleString("en")} ${what}`).join(", ");
}

/** How the parts of a run met and who flew it: "iceoryx2, real time; controller: rotortwin-controller 0.1.0, in lockstep". */
export function peersOf(summary: Summary): string {
  const link = [summary.link, summary.pace === "real-time" ? "real time" : undefined].filter(Boolean).join(", ");
  const flew = summary.controller;
  return [link, flew && `controller: ${[flew.peer, flew.version].filter(Boolean).join(" ")}, ${flew.lockstep ? "in lockstep" : "not in lockstep: the same seed gives another flight"}`].filter(Boolean).join("; ");
}

const CAUSES: Readonly<Record<string, string>> = { scheduler: "waited for a processor", computing: "was computing", unknown: "for a reason that is not known" };
/** Who was late and why: "controller waited for a processor: 3 steps, 4.1 ms at worst". */
export const lateWords = (late: { who: string; why: string; steps: number; worst_ms: number }) =>
  `${late.who === "fdi" ? "FDI engine" : late.who} ${CAUSES[late.why] ?? late.why}: ${late.steps.toLocaleString("en")} ${late.steps === 1 ? "step" : "steps"}, ${Number(late.worst_ms.toPrecision(3))} ms at worst`;

/** Intervals with a faulty rotor or sensor. */
export const faultIntervals = (summary: Summary | undefined): [number, number][] =>
  (summary?.intervals ?? []).filter((one) => one.fault_label !== HEALTHY || (one.sensor_faults?.length ?? 0) > 0).map((one) => [one.start_s, one.end_s]);

export interface Samples extends Track {
  units: Readonly<Record<string, string>>;
}

/** Samples of a finished run, at most `points` rows of an interval. */
export async function samplesOf(run: string, channels: string, points: number, range: readonly [number, number] | undefined, signal: AbortSignal): Promise<Samples> {
  const query = new URLSearchParams({ channels, points: String(points) });
  if (range) {
    query.set("from_s", String(Math.max(0, range[0])));
    query.set("to_s", String(range[1]));
  }
  const answer = await ask<Schemas["Telemetry"]>("GET", `/api/v1/runs/${run}/telemetry?${query}`, undefined, { signal });
  return { time: (answer.data["time_s"] ?? []) as number[], data: answer.data, units: answer.units };
}

/** Collects the samples of a live run; discards those that are flown again. */
export class Collector {
  readonly time: number[] = [];
  readonly data: Record<string, (number | null)[]> = {};
  readonly units: Record<string, string> = {};

  /** True if there are new samples. */
  take(message: LiveMessage): boolean {
    if (message.type === "start") {
      for (const channel of message.channels) {
        this.units[channel.name] = channel.unit;
        this.data[channel.name] ??= this.time.map(() => null);
      }
      return false;
    }
    if (message.type === "history") {
      message.time_s.forEach((time, k) => this.add(time, (name) => message.values[name]?.[k] ?? null));
      return true;
    }
    if (message.type === "sample") {
      this.add(message.time_s, (name) => message.values[name] ?? null);
      return true;
    }
    return false;
  }

  private add(time: number, value: (name: string) => number | null): void {
    // A restarted run begins at 0: the samples so far belong to the previous attempt.
    if (time + FLOWN_AGAIN_S < (this.time.at(-1) ?? -Infinity)) {
      this.time.length = 0;
      for (const values of Object.values(this.data)) values.length = 0;
    }
    if (time <= (this.time.at(-1) ?? -Infinity)) return;
    this.time.push(time);
    for (const [name, values] of Object.entries(this.data)) values.push(value(name));
  }
}

/** Every n-th row, so that a plot has no more points than a screen shows; always the same rows, and the last one. */
export function thinned(samples: Samples, most: number): Samples {
  const every = Math.ceil(samples.time.length / most);
  if (every <= 1) return samples;
  const last = samples.time.length - 1;
  const pick = <T>(values: readonly T[]): T[] => {
    const kept: T[] = [];
    for (let k = 0; k < values.length; k += every) kept.push(values[k] as T);
    if (last % every !== 0 && values.length > last) kept.push(values[last] as T);
    return kept;
  };
  return { time: pick(samples.time), data: Object.fromEntries(Object.entries(samples.data).map(([name, values]) => [name, pick(values)])), units: samples.units };
}
