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
    expect(asCommand(own, "http://h")).toBe("rotortwin fly @short-hover --seed 7 --model @mine@v1 --fdi-model @other --pace fast --link in-process --server http://h");
    expect(asCurl(own, "http://h")).toContain('"model":{"model":"mine@v1"},"fdi_model":{"model":"other"}');
    expect(asPython(own, "http://h")).toContain('fdi_model={"model":"other"}');
  });
  it("names an autopilot, which has pace and link of its own", () => {
    const flown: Wish = { ...wish, set: [], autopilot: "bench-1" };
    expect(asCommand(flown, "http://h")).toContain("--autopilot bench-1 --server http://h");
    expect(asCurl(flown, "http://h")).toContain('{"scenario":"short-hover","seed":7,"controller":{"autopilot":"bench-1"}}');
    expect(asPython(flown, "http://h")).toContain('controller={"autopilot":"bench-1"})');
  });
  it("flies a scenario of one's own where it is", () => {
    expect(asCommand({ ...wish, seed: undefined, set: [], own: true }, "http://h")).toBe("rotortwin fly @short-hover --pace fast --link in-process --server http://h");
  });
  it("takes the token from the environment where one is needed", () => {
    const asked: Wish = { ...wish, set: [], token: true };
    expect(asCurl(asked, "http://h")).toContain('http://h/api/v1/runs -H "authorization: Bearer $ROTORTWIN_TOKEN" -H');
    expect(asPython(asked, "http://h")).toContain('import os\n\nfrom rotortwin import Client\n\nclient = Client("http://h", token=os.environ["ROTORTWIN_TOKEN"])');
  });
  it("keeps every setting", () => {
    expect(asCommand(wish, "http://h")).toContain("rotortwin fly short-hover --seed 7 --set initial.state_of_charge=0.6 --set 'effect=[{effect='\\''rotor-drag'\\''}]'");
    const body = /-d '(.*)'$/s.exec(asCurl(wish, "http://h"))?.[1]?.replaceAll(`'\\''`, "'") ?? "";
    expect(JSON.parse(body)).toEqual({ scenario: "short-hover", seed: 7, set: wish.set, pace: "fast", link: "in-process" });
    expect(asPython(wish, "http://h")).toContain('client.runs.submit("short-hover", seed=7, set=["initial.state_of_charge=0.6"');
  });
});
