/** A vehicle from a log: the request, and its result in words. */
import type { Schemas } from "../api/client";
import { count, percent } from "../format";
import type { Lane } from "../plots/lanes";
import type { Rotor } from "../replay/motion";

export type Source = Schemas["ConstantSource"];
export type Estimate = Schemas["IdentifiedValue"];
/** The result of `/identifications/{id}`. */
export type Identification = Schemas["Identification"];

const SOURCE_WORDS: Record<Source, { words: string; kind: string }> = {
  entered: { words: "entered", kind: "" },
  log: { words: "log", kind: "good" },
  "log-and-class": { words: "log + class default", kind: "warn" },
  parameter: { words: "parameter in the log", kind: "good" },
  bench: { words: "bench", kind: "good" },
  class: { words: "class default: a guess", kind: "warn" },
  stated: { words: "as stated", kind: "" },
  assumed: { words: "assumed", kind: "" },
};
export const sourceOf = (source: Source) => SOURCE_WORDS[source] ?? { words: source, kind: "" };

/** Data of a flight that was fitted. */
export const usedLane = (found: Identification["identified"], log: string): Lane => ({
  name: "used",
  stretches: found.airborne.filter((part) => part.log === log).map((part) => ({ from: part.start_s, to: part.end_s, code: 0 })),
  words: () => "used",
});

/** Channels of the validation, in plain words. */
const CHANNELS: Record<string, string> = {
  "vertical specific force": "thrust: what the accelerometer reads along the vehicle's axis",
  "the same without drift": "the same without slow drift (battery, weather)",
  "roll acceleration": "how the vehicle begins to roll",
  "pitch acceleration": "how the vehicle begins to pitch",
  "yaw acceleration": "how the vehicle begins to turn",
};
export const channelWords = (channel: string) => CHANNELS[channel] ?? channel;

/** A frequency band in Hz, described as slow or fast motion. */
export function bandWords(band: { low_hz: number; high_hz: number }): string {
  const hz = (value: number) => Number(value.toPrecision(2));
  return band.low_hz > 0 ? `${hz(band.low_hz)} to ${hz(band.high_hz)} Hz` : `from standing still to ${hz(band.high_hz)} Hz`;
}

/** R² as a percentage; a fit worse than the mean has none. */
export const predicted = (r2: number) => (r2 < 0 ? "worse than the mean" : percent(r2));

/** R² from which a channel counts as predicted, and below which it is not. */
const PREDICTED = 0.9;
const HARDLY = 0.5;
/** Channels of the validation as the subject of a sentence. */
const SUBJECTS: Record<string, string> = {
  "vertical specific force": "thrust", "the same without drift": "thrust without slow drift", "roll acceleration": "roll", "pitch acceleration": "pitch", "yaw acceleration": "yaw",
};

/** Where the vehicle fails on the half of a flight that it was not fitted to: the answer in a sentence. */
export function failsOn(scores: Identification["held_out"]): { head: string; rest: string; kind: string } | undefined {
  const all = scores.flatMap((log) => log.scores);
  if (all.length === 0) return undefined;
  const words = (list: typeof all) => list.map((one) => `${SUBJECTS[one.channel] ?? one.channel} ${one.calibrated < 0 ? "worse than the mean" : percent(one.calibrated, 0)}`).join(", ");
  const [good, fair, bad] = [all.filter((one) => one.calibrated >= PREDICTED), all.filter((one) => one.calibrated >= HARDLY && one.calibrated < PREDICTED), all.filter((one) => one.calibrated < HARDLY)];
  const rest = [good.length > 0 ? `Predicted: ${words(good)}.` : "", fair.length > 0 ? `In part: ${words(fair)}.` : "", bad.length > 0 ? `Hardly or not: ${words(bad)}.` : ""].filter(Boolean).join(" ");
  if (fair.length + bad.length === 0) return { head: "On the half of the flight that it was not fitted to, it predicts every motion.", rest, kind: "good" };
  const failing = [...bad, ...fair].map((one) => SUBJECTS[one.channel] ?? one.channel);
  return { head: `On the half of the flight that it was not fitted to, it still fails in ${failing.join(", ")}.`, rest, kind: "warn" };
}

/** How a value is known, without repeating the source. */
export function knownHow(it: { source: Source; how: string }): string {
  const words = sourceOf(it.source).words;
  return it.how.startsWith(words) ? it.how : `${words} (${it.how})`;
}

/** The summary: how much of the vehicle is known, and how much is guessed. */
export function answerOf(values: readonly Estimate[]): { head: string; rest: string; kind: string } {
  // Universal constants are neither.
  const asked = values.filter((one) => one.source !== "assumed" && one.source !== "entered");
  const guesses = asked.filter((one) => one.source === "class");
  const partly = asked.filter((one) => one.source === "log-and-class");
  const known = asked.length - guesses.length - partly.length;
  const names = (list: readonly Estimate[]) => list.map((one) => one.name).join(", ");
  const parts = [
    guesses.length > 0 ? `A guess from vehicles of this size: ${names(guesses)}.` : "",
    partly.length > 0 ? `Narrowed by the flight, not settled: ${names(partly)}.` : "",
  ];
  return {
    head: guesses.length + partly.length === 0 ? "Every constant is known." : `${known} of ${count(asked.length, "constant")} are known.`,
    rest: parts.filter(Boolean).join(" "),
    kind: guesses.length === 0 ? "good" : "warn",
  };
}

/** What may be improved first, then what is known, then what was entered. */
export const inOrder = (values: readonly Estimate[]): Estimate[] => {
  const order: Source[] = ["class", "log-and-class", "log", "bench", "parameter", "entered", "stated", "assumed"];
  return [...values].sort((a, b) => order.indexOf(a.source) - order.indexOf(b.source));
};

/** Values grouped by confidence; those that need attention first. */
export function groupsOf(values: readonly Estimate[]): { title: string; values: Estimate[]; open: boolean }[] {
  const of = (...sources: Source[]) => values.filter((one) => sources.includes(one.source));
  const groups = [
    { title: "Known: measured in flight, on a bench, or stored in the log", values: of("log", "parameter", "bench"), open: true },
    { title: "Guesses, as far as the flight does not say", values: of("class", "log-and-class"), open: true },
    { title: "As you entered it, and what is taken for granted", values: of("entered", "stated", "assumed"), open: false },
  ];
  return groups.filter((group) => group.values.length > 0);
}

/** Frames to choose from if the log does not name one; motors are numbered as in ArduPilot. */
export const FRAMES = [
  "quad-x", "quad-plus", "quad-v", "quad-h", "quad-betaflight-x", "quad-dji-x", "quad-cw-x", "quad-betaflight-x-reversed",
  "hexa-x", "hexa-plus", "hexa-dji-x", "hexa-cw-x", "octo-x", "octo-plus", "octo-dji-x", "octo-cw-x", "octaquad-x", "octaquad-plus", "octaquad-h", "y6a", "y6b", "y6f",
] as const;

/** A valid document name derived from a file name. */
export function nameFrom(file: string): string {
  const stem = file.replace(/\.[^.]*$/, "").toLowerCase();
  const name = stem.replace(/[^a-z0-9._-]+/g, "-").replace(/^[^a-z0-9]+/, "").replace(/[-._]+$/, "");
  return name.slice(0, 40) || "mine";
}

/** What is wrong with a document's name, in the server's words. */
export function nameProblem(name: string): string | undefined {
  if (/^[a-z0-9][a-z0-9._-]{0,63}$/.test(name)) return undefined;
  return `'${name}' is not a valid document name; expected 1 to 64 of a-z, 0-9, '.', '_' and '-', beginning with a letter or digit.`;
}

/** Parses a positive number as typed; otherwise an error message. */
export function numberOf(text: string, what: string, unit: string): { value?: number; problem?: string } {
  const trimmed = text.trim().replace(",", ".");
  const value = Number(trimmed);
  if (trimmed !== "" && Number.isFinite(value) && value > 0) return { value };
  return { problem: trimmed === "" ? `${what}: expected a number, ${unit}.` : `${what}: '${text}' is no number above 0, ${unit}.` };
}

/** Positions of the rotors from the vehicle's document; undefined if its lines are not in the known form. */
export function rotorsOf(vehicle: string): Rotor[] | undefined {
  const rows = [...vehicle.matchAll(/\{\s*number = (\d+), position_body_m = \[([^\]]+)\], spin = "(cw|ccw)"/g)];
  const rotors = rows.map((row) => {
    const [x = NaN, y = NaN, z = NaN] = (row[2] ?? "").split(",").map(Number);
    return { number: Number(row[1]), position_body_m: [x, y, z] satisfies Rotor["position_body_m"], spin: row[3] as Rotor["spin"] };
  });
  return rotors.length > 0 && rotors.every((rotor) => rotor.position_body_m.every(Number.isFinite)) ? rotors : undefined;
}

/** Replaces command-line options by the form's fields. */
export const adviceText = (better: string) => better.replace(/(?<=^|\s)--(\w+)/g, "the $1");

/** How to improve the vehicle: each recommendation once, with the values it concerns. */
export function adviceOf(values: readonly Estimate[]): { better: string; names: string[] }[] {
  const found = new Map<string, string[]>();
  for (const value of values) {
    if ((value.source !== "class" && value.source !== "log-and-class") || value.better === "") continue;
    const better = adviceText(value.better);
    found.set(better, [...(found.get(better) ?? []), value.name]);
  }
  return [...found].map(([better, names]) => ({ better, names }));
}
