import { describe, expect, it } from "vitest";
import { type Wish, asCommand, asCurl, asPython, quoted } from "./commands";

const wish: Wish = { scenario: "short-hover", seed: "7", set: ["initial.state_of_charge=0.6", "effect=[{effect='rotor-drag'}]"], pace: "fast", link: "in-process" };

describe("the same run by other means", () => {
  it("quotes words for a shell", () => {
    expect(quoted("a.b=0.6")).toBe("a.b=0.6");
    expect(quoted("it's $HOME")).toBe(`'it'\\''s $HOME'`);
  });
  it("names the models that fly and that the detectors assume", () => {
    const own: Wish = { ...wish, set: [], model: "mine@v1", fdiModel: "other" };
    expect(asCommand(own, "http://h")).toContain("--model mine@v1 --fdi-model other");
    expect(asCurl(own, "http://h")).toContain('"model":{"model":"mine@v1"},"fdi_model":{"model":"other"}');
    expect(asPython(own, "http://h")).toContain('fdi_model={"model":"other"}');
  });
  it("names an autopilot, which has pace and link of its own", () => {
    const flown: Wish = { ...wish, set: [], autopilot: "bench-1" };
    expect(asCommand(flown, "http://h")).toContain("--autopilot bench-1 --server http://h");
    expect(asCurl(flown, "http://h")).toContain('{"scenario":"short-hover","seed":7,"controller":{"autopilot":"bench-1"}}');
    expect(asPython(flown, "http://h")).toContain('controller={"autopilot":"bench-1"})');
  });
  it("keeps every setting", () => {
    expect(asCommand(wish, "http://h")).toContain("--seed 7 --set initial.state_of_charge=0.6 --set 'effect=[{effect='\\''rotor-drag'\\''}]'");
    const body = /-d '(.*)'$/s.exec(asCurl(wish, "http://h"))?.[1]?.replaceAll(`'\\''`, "'") ?? "";
    expect(JSON.parse(body)).toEqual({ scenario: "short-hover", seed: 7, set: wish.set, pace: "fast", link: "in-process" });
    expect(asPython(wish, "http://h")).toContain('client.runs.submit("short-hover", seed=7, set=["initial.state_of_charge=0.6"');
  });
});
