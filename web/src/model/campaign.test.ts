import { describe, expect, it } from "vitest";
import { cumulativeOn, seriesOn, verdictConfusion } from "./campaign";

describe("pictures of a campaign", () => {
  it("puts series on common times", () => {
    const both = [{ x: [1, 4], y: [10, 40] }, { x: [2, 4], y: [5, 6] }];
    expect(seriesOn(both)).toEqual({ x: [1, 2, 4], y: [[10, null, 40], [null, 5, 6]] });
    expect(cumulativeOn(both).y).toEqual([[10, 10, 40], [0, 5, 6]]);
  });
  it("joins pairs of rotors if there are many, and keeps a few", () => {
    const few = verdictConfusion([[1, 1, 90], [1, 102, 10]]);
    expect(few.names).toEqual(["rotor 1", "rotors 1 and 2"]);
    expect(few.codes).toEqual({ truths: [[1]], names: [[1], [102]] });
    const many = verdictConfusion([[-1, -1, 7], [1, 1, 90], [0, 0, 5], ...[102, 103, 104, 105, 106].map((code): [number, number, number] => [1, code, 2])]);
    expect(many.truths).toEqual(["healthy", "rotor 1", "several rotors"]);
    expect(many.names).toEqual(["healthy", "rotor 1", "several rotors", "unknown fault"]);
    expect(many.codes?.names).toEqual([[0], [1], [102, 103, 104, 105, 106], [-1]]);
    expect(many.counts).toEqual([[5, 0, 0, 0], [0, 90, 10, 0], [0, 0, 0, 7]]);
  });
});
