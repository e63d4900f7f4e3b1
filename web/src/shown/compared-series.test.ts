import { describe, expect, it } from "vitest";
import { type ComparisonReport, seriesOf, within } from "./compared-series";

const report = {
  comparison: { models: [{ label: "f550@v0" }, { label: "f550@v1" }] },
  pictures: [
    {
      start_s: 0, end_s: 0.3, bucket_s: 0.1, time_s: [0.05, 0.15, 0.25],
      conditions: [{ name: "speed", title: "speed", unit: "m/s", mean: [1, 3, null] }],
      channels: [{
        channel: "fx", unit: "N", noise: { sample: 1, mean: 0.5 }, measured: [10, 20, 30],
        residuals: [{ mean: [1, 2, null], low: [0, 1, null], high: [2, 3, null] }, { mean: [0, 0, 0], low: [0, 0, 0], high: [0, 0, 0] }],
      }],
    },
  ],
} as unknown as ComparisonReport;

describe("series of a report", () => {
  it("predicts what was measured less the residual", () => {
    const series = seriesOf(report, 0, "fx");
    expect(series?.models.map((one) => one.predicted.mean)).toEqual([[9, 18, null], [10, 20, 30]]);
    expect(series?.models[0]?.residual.high).toEqual([2, 3, null]);
    expect(series?.models[1]?.label).toBe("f550@v1");
    expect(seriesOf(report, 0, "v")).toBeUndefined();
    expect(seriesOf(report, 1, "fx")).toBeUndefined();
  });
  it("shows only where a condition is within bounds; where it is not known it is not", () => {
    const only = { condition: "speed", low: 2, high: Infinity };
    expect(within(report.pictures[0]!, only)).toEqual([false, true, false]);
    expect(seriesOf(report, 0, "fx", only)?.measured.mean).toEqual([null, 20, null]);
    expect(within(report.pictures[0]!, undefined)).toEqual([true, true, true]);
  });
});
