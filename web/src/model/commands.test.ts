import { describe, expect, it } from "vitest";
import { type Wish, asCommand, asCurl, asPython, quoted } from "./commands";

const wish: Wish = { scenario: "short-hover", seed: 7, set: ["initial.state_of_charge=0.6", "effect=[{effect='rotor-drag'}]"], pace: "fast", link: "in-process" };

describe("the same run by other means", () => {
  it("quotes words for a shell", () => {
    expect(quoted("a.b=0.6")).toBe("a.b=0.6");
    expect(quoted("it's $HOME")).toBe(`'it'\\''s $HOME'`);
  });
  it("names the models that fly and that the detectors assume", () => {
    const own: Wish = { ...wish, set: [], model: "mine@v1", fdiModel: "other" };
    expect(asCommand(own)).toContain("--model mine@v1 --fdi-model other");
    expect(asCurl(own, "http://h")).toContain('"model":{"model":"mine@v1"},"fdi_model":{"model":"other"}');
    expect(asPython(own, "http://h")).toContain('fdi_model={"model":"other"}');
  });
  it("keeps every setting", () => {
    expect(asCommand(wish)).toContain("--seed 7 --set initial.state_of_charge=0.6 --set 'effect=[{effect='\\''rotor-drag'\\''}]'");
    const body = /-d '(.*)'$/s.exec(asCurl(wish, "http://h"))?.[1]?.replaceAll(`'\\''`, "'") ?? "";
    expect(JSON.parse(body)).toEqual({ scenario: "short-hover", seed: 7, set: wish.set, pace: "fast", link: "in-process" });
    expect(asPython(wish, "http://h")).toContain('client.runs.submit("short-hover", seed=7, set=["initial.state_of_charge=0.6"');
  });
});
