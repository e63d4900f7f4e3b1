/** Ranges of axes and their tick labels. */
import uPlot from "uplot";

/** Digits of a tick label. */
const TICK_DIGITS = 6;
/** Margin above and below the data, as a share of the range. */
const PADDING = 0.1;

/** A tick label without meaningless digits. */
export const tickText = (value: number) => `${Number(value.toPrecision(TICK_DIGITS))}`.replace(/^-/, "−");

/**
 * The range of an axis for values from `least` to `largest`. What varies by less than the axis' numbers can tell is drawn as constant. uPlot
 * itself does so only below a share of 1e-10; above it, up to some 1e-8, it may round both ends to the same number and never ends placing ticks.
 */
export function rangeOf(least: number | null, largest: number | null): uPlot.Range.MinMax {
  if (least === null || largest === null) return [null, null];
  const told = Math.max(Math.abs(least), Math.abs(largest)) * 10 ** (1 - TICK_DIGITS);
  if (largest - least >= told) return uPlot.rangeNum(least, largest, PADDING, true);
  const middle = (least + largest) / 2;
  return uPlot.rangeNum(middle, middle, PADDING, true);
}
