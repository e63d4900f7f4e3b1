/** Calculations on series, shared by the plots. Times increase; a missing value is null. */

export type Values = readonly (number | null)[];

/** Index of the last time that is not after `at`; 0 before the first. */
export function placeAt(times: readonly number[], at: number): number {
  let low = 0;
  let high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if ((times[middle] ?? Infinity) <= at) low = middle;
    else high = middle - 1;
  }
  return Math.max(0, low);
}

/** The value in force at `at`. */
export function heldAt(times: readonly number[], values: Values, at: number): number | null {
  return values[placeAt(times, at)] ?? null;
}

/** Linear interpolation between two samples; null if either is missing. */
export function linearAt(times: readonly number[], values: Values, at: number): number | null {
  const place = placeAt(times, at);
  const [from, to] = [times[place], times[place + 1]];
  const [before, after] = [values[place] ?? null, values[place + 1] ?? null];
  if (from === undefined || to === undefined || at <= from || before === null) return before;
  if (after === null) return null;
  return before + ((after - before) * (at - from)) / (to - from);
}

/** Interpolates an angle between two samples, the short way round. */
export function angleAt(times: readonly number[], values: Values, at: number): number | null {
  const place = placeAt(times, at);
  const [from, to] = [times[place], times[place + 1]];
  const [before, after] = [values[place] ?? null, values[place + 1] ?? null];
  if (from === undefined || to === undefined || at <= from || before === null) return before;
  if (after === null) return null;
  const turn = Math.atan2(Math.sin(after - before), Math.cos(after - before));
  return before + (turn * (at - from)) / (to - from);
}

/** An interval of constant code. */
export interface Stretch {
  from: number;
  to: number;
  code: number;
}

/** Intervals of constant code; the last one ends at the last time. */
export function stretches(times: readonly number[], codes: Values): Stretch[] {
  const found: Stretch[] = [];
  for (let k = 0; k < times.length; k += 1) {
    const code = codes[k];
    const time = times[k];
    if (code === null || code === undefined || time === undefined) continue;
    const last = found.at(-1);
    if (last && last.code === code) last.to = time;
    else {
      if (last) last.to = time;
      found.push({ from: time, to: time, code });
    }
  }
  return found;
}

/** Centred moving mean of `window` values; null where there is none. */
export function movingMean(values: Values, window: number): Values {
  const half = Math.floor(window / 2);
  let [sum, count] = [0, 0];
  const take = (place: number, sign: number) => {
    const value = values[place];
    if (typeof value !== "number") return;
    sum += sign * value;
    count += sign;
  };
  for (let place = 0; place < half; place += 1) take(place, 1);
  return values.map((value, place) => {
    take(place + half, 1);
    take(place - half - 1, -1);
    return value === null || count === 0 ? null : sum / count;
  });
}

export interface Extent {
  least: number;
  largest: number;
  mean: number;
  last: number;
}

/** Minimum, maximum, mean and last value; undefined if there are none. */
export function extent(values: Values): Extent | undefined {
  let [least, largest, sum, n, last] = [Infinity, -Infinity, 0, 0, 0];
  for (const value of values) {
    if (value === null || !Number.isFinite(value)) continue;
    if (value < least) least = value;
    if (value > largest) largest = value;
    sum += value;
    n += 1;
    last = value;
  }
  return n === 0 ? undefined : { least, largest, mean: sum / n, last };
}

/** At most `most` indices, spread evenly over `from..to` of the times, for a table. */
export function samplePlaces(times: readonly number[], range: readonly [number, number] | undefined, most: number): number[] {
  const from = range ? placeAt(times, range[0]) : 0;
  const to = range ? placeAt(times, range[1]) : times.length - 1;
  const n = to - from + 1;
  if (n <= 0) return [];
  if (n <= most) return Array.from({ length: n }, (_, k) => from + k);
  return Array.from({ length: most }, (_, k) => from + Math.round((k * (n - 1)) / (most - 1)));
}
