import { describe, expect, it } from "vitest";
import { confusionOf } from "./confusion";

describe("confusionOf", () => {
  it("puts what was right on the diagonal and loses no case", () => {
    const found = confusionOf([["drag", "drag", 5], ["nothing", "nothing", 9], ["drag", "gusts", 1], ["mass", "drag", 2]]);
    expect(found.truths).toEqual(["nothing", "drag", "mass"]);
    expect(found.names).toEqual(["nothing", "drag", "gusts"]);
    expect(found.counts).toEqual([[9, 0, 0], [0, 5, 1], [0, 2, 0]]);
  });
});
