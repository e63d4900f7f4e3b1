/** Calculations for a campaign's plots. */
import { verdictText } from "../format";
import type { Values } from "../plots/series";
import type { Confusion } from "./confusion";

/** Truth, verdict, windows. */
export type VerdictCount = [number, number, number];
/** Verdict codes from here on name two rotors. */
const PAIR = 100;
/** More pairs than this do not fit in a table. */
const MOST_PAIRS = 4;
const SEVERAL = -1;

/** Windows of each truth by verdict. Many pairs are merged into one column. */
export function verdictConfusion(counts: readonly VerdictCount[]): Confusion {
  const joined = new Set(counts.map(([, verdict]) => verdict).filter((code) => code >= PAIR)).size > MOST_PAIRS;
  const truth = (code: number) => (code === SEVERAL ? "several rotors" : verdictText(code));
  const verdict = (code: number) => (joined && code >= PAIR ? "several rotors" : verdictText(code));
  // Healthy, the rotors, pairs, then verdicts without a rotor; not by their counts, which differ between detectors.
  const place = (code: number) => (code < 0 ? 1e6 - code : code);
  const sorted = (codes: readonly number[], name: (code: number) => string) => [...new Set([...codes].sort((a, b) => place(a) - place(b)).map(name))];
  const [truths, names] = [sorted(counts.map(([code]) => code), truth), sorted(counts.map(([, code]) => code), verdict)];
  const windows = truths.map((one) => names.map((other) => counts.filter(([a, b]) => truth(a) === one && verdict(b) === other).reduce((sum, [, , count]) => sum + count, 0)));
  const codes = (all: readonly number[], words: readonly string[], name: (code: number) => string) => words.map((word) => [...new Set(all)].filter((code) => name(code) === word).sort((a, b) => a - b));
  return { truths, names, counts: windows, codes: { truths: codes(counts.map(([code]) => code), truths, truth), names: codes(counts.map(([, code]) => code), names, verdict) } };
}

export interface Points {
  x: readonly number[];
  y: readonly number[];
}

/** Merges several series onto the union of their times; null where a series has no point. */
export function seriesOn(series: readonly Points[]): { x: number[]; y: Values[] } {
  const x = [...new Set(series.flatMap((one) => [...one.x]))].sort((a, b) => a - b);
  const y = series.map((one) => {
    const known = new Map(one.x.map((at, k) => [at, one.y[k] ?? null]));
    return x.map((at) => known.get(at) ?? null);
  });
  return { x, y };
}

/** The same for increasing series: held from point to point, 0 before the first. */
export function cumulativeOn(series: readonly Points[]): { x: number[]; y: Values[] } {
  const { x, y } = seriesOn(series);
  return {
    x,
    y: y.map((values) => {
      let last = 0;
      return values.map((value) => (last = value ?? last));
    }),
  };
}
