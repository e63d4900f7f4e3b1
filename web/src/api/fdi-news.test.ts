import { describe, expect, it } from "vitest";
import { type Session, after } from "./fdi-news";

const session = (id: string, samples: number) => ({ id, samples }) as Session;

describe("sessions after an event", () => {
  const before = [session("a", 1), session("c", 1)];
  it("begins again with all that are open", () => {
    expect(after(before, "open", { items: [session("x", 0)] })).toEqual([session("x", 0)]);
  });
  it("replaces the one that was fed, and keeps the order", () => {
    expect(after(before, "session", session("a", 2))).toEqual([session("a", 2), session("c", 1)]);
    expect(after(before, "session", session("b", 0)).map((one) => one.id)).toEqual(["a", "b", "c"]);
  });
  it("forgets the one that is closed", () => {
    expect(after(before, "closed", { id: "a" })).toEqual([session("c", 1)]);
  });
});
