import { describe, expect, it } from "vitest";
import { angleAt, extent, heldAt, linearAt, movingMean, placeAt, samplePlaces, stretches } from "./series";

const times = [0, 1, 2, 4];

describe("series", () => {
  it("finds the place of a time", () => {
    expect([-1, 0, 0.5, 1, 3.9, 4, 9].map((at) => placeAt(times, at))).toEqual([0, 0, 0, 1, 2, 3, 3]);
    expect(placeAt([], 1)).toBe(0);
  });
  it("holds and interpolates", () => {
    expect(heldAt(times, [1, 2, 3, 4], 3)).toBe(3);
    expect(linearAt(times, [1, 2, 3, 5], 3)).toBe(4);
    expect(linearAt(times, [1, null, 3, 5], 0.5)).toBeNull();
    expect(linearAt(times, [1, 2, 3, 5], 99)).toBe(5);
  });
  it("turns angles the short way round", () => {
    const half = angleAt([0, 1], [3.1, -3.1], 0.5) ?? 0;
    expect(Math.abs(Math.cos(half) + 1)).toBeLessThan(1e-3);
  });
  it("joins equal codes", () => {
    expect(stretches(times, [0, 0, 3, 3])).toEqual([
      { from: 0, to: 2, code: 0 },
      { from: 2, to: 4, code: 3 },
    ]);
    expect(stretches(times, [null, null, null, null])).toEqual([]);
  });
  it("takes extents without the gaps", () => {
    expect(extent([null, 2, -1, 5])).toEqual({ least: -1, largest: 5, mean: 2, last: 5 });
    expect(extent([null])).toBeUndefined();
  });
  it("samples a table evenly with both ends", () => {
    const many = Array.from({ length: 1000 }, (_, k) => k);
    const places = samplePlaces(many, undefined, 25);
    expect(places.length).toBe(25);
    expect([places[0], places.at(-1)]).toEqual([0, 999]);
    expect(samplePlaces(many, [10, 12], 25)).toEqual([10, 11, 12]);
  });
});

describe("movingMean", () => {
  it("takes the values around each one that are there", () => {
    expect(movingMean([1, 2, 3, 4, 5], 3)).toEqual([1.5, 2, 3, 4, 4.5]);
    expect(movingMean([1, null, 3], 3)).toEqual([1, null, 3]);
    expect(movingMean([], 5)).toEqual([]);
  });
});
