/** A confusion matrix from its counted pairs. */

export interface Confusion {
  /** Truths. */
  truths: string[];
  /** Verdicts. */
  names: string[];
  counts: number[][];
  /** Codes of each row and each column, where they are codes. */
  codes?: { truths: number[][]; names: number[][] };
}

/** Rows and columns in the same order, so that the diagonal is correct; largest rows first. */
export function confusionOf(pairs: readonly (readonly [string, string, number])[]): Confusion {
  const sums = new Map<string, number>();
  for (const [truth, , count] of pairs) sums.set(truth, (sums.get(truth) ?? 0) + count);
  const truths = [...sums.keys()].sort((a, b) => (sums.get(b) ?? 0) - (sums.get(a) ?? 0) || a.localeCompare(b));
  const named = new Set(pairs.map(([, name]) => name));
  const names = [...truths.filter((name) => named.has(name)), ...[...named].filter((name) => !sums.has(name)).sort()];
  const counts = truths.map((truth) => names.map((name) => pairs.filter(([a, b]) => a === truth && b === name).reduce((sum, [, , count]) => sum + count, 0)));
  return { truths, names, counts };
}
