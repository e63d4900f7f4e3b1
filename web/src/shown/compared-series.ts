/** Series of a comparison that are stored in its report. */
import type { FlightPicture } from "../model/flight";
import type { Comparison, Series } from "../model/twin";
import type { Values } from "../plots/series";

/** Series of one log in the report: means of the measurements; means and extremes of the residuals. */
export interface LogPictures {
  start_s: number;
  end_s: number;
  bucket_s: number;
  time_s: number[];
  /** Means of the flight conditions. */
  conditions: { name: string; title: string; unit: string; mean: Values }[];
  channels: { channel: string; unit: string; noise: Series["noise"]; measured: Values; residuals: { mean: Values; low: Values; high: Values }[] }[];
}
export interface ComparisonReport {
  comparison: Comparison;
  pictures: LogPictures[];
  /** The same logs, in display form. */
  flights?: FlightPicture[];
}

/** Only the buckets in which a flight condition is within bounds. */
export interface Only {
  condition: string;
  low: number;
  high: number;
}

/** Which buckets of a log count. */
export function within(pictures: LogPictures, only: Only | undefined): boolean[] {
  const values = only && pictures.conditions.find((one) => one.name === only.condition)?.mean;
  return pictures.time_s.map((_, k) => {
    if (!only || !values) return true;
    const value = values[k];
    return typeof value === "number" && value >= only.low && value <= only.high;
  });
}

/** The series of one channel, as from a server; null where a condition is out of bounds. */
export function seriesOf(report: ComparisonReport, log: number, channel: string, only?: Only): Series | undefined {
  const pictures = report.pictures[log];
  const all = pictures?.channels.find((one) => one.channel === channel);
  if (!pictures || !all) return undefined;
  const counts = within(pictures, only);
  const cut = (values: Values) => values.map((value, k) => (counts[k] ? value : null));
  const found = { ...all, measured: cut(all.measured), residuals: all.residuals.map((one) => ({ mean: cut(one.mean), low: cut(one.low), high: cut(one.high) })) };
  const none: number[] = [];
  return {
    channel, unit: found.unit, start_s: pictures.start_s, end_s: pictures.end_s, bucket_s: pictures.bucket_s, time_s: pictures.time_s, noise: found.noise,
    measured: { mean: found.measured, low: none, high: none },
    models: found.residuals.map((residual, place) => {
      const mean = found.measured.map((value, k) => (value === null || typeof residual.mean[k] !== "number" ? null : value - (residual.mean[k] as number)));
      return { label: report.comparison.models[place]?.label ?? "", predicted: { mean, low: none, high: none }, residual };
    }),
  };
}
