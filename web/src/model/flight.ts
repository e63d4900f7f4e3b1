/** A flight for display: the server's analysis of it, and its texts. */
import type { Schemas } from "../api/client";
import type { Lane } from "../plots/lanes";
import type { Stretch, Values } from "../plots/series";

export type FlightPicture = Schemas["FlightPicture"];
type Part = FlightPicture["parts"]["parts"][number];
type Event = FlightPicture["parts"]["events"][number];

/** Kinds of parts: texts and styles. */
const PARTS: Record<string, { words: string; look: "idle" | "healthy" | "unknown" }> = {
  ground: { words: "on the ground", look: "idle" },
  "take-off": { words: "taking off", look: "idle" },
  air: { words: "in the air", look: "healthy" },
  landing: { words: "landing", look: "idle" },
  upset: { words: "upset", look: "unknown" },
  crash: { words: "crash", look: "unknown" },
};
export const partOf = (kind: string | undefined) => PARTS[kind ?? ""] ?? { words: "not known", look: "idle" as const };

/** Parts of a flight; a code is the negated index of its kind, as positive ones are rotors. */
export function partLane(parts: readonly Pick<Part, "kind" | "start_s" | "end_s">[]): Lane {
  const kinds = [...new Set(parts.map((part) => part.kind))];
  return {
    name: "parts",
    stretches: parts.map((part) => ({ from: part.start_s, to: part.end_s, code: -kinds.indexOf(part.kind) })),
    words: (code) => partOf(kinds[-code]).words,
    look: (code) => partOf(kinds[-code]).look,
  };
}

/** Kinds of events in the order of their lanes. */
const EVENTS: readonly { kind: Event["kind"]; name: string }[] = [
  { kind: "saturated", name: "saturated" },
  { kind: "lost-rotor", name: "lost rotor" },
  { kind: "motor-off", name: "motor off" },
  { kind: "estimator-reset", name: "jumps" },
  { kind: "hard-landing", name: "hard landing" },
  { kind: "gap", name: "no rows" },
];
/** Least width of an event as a share of the flight, so that it is visible. */
const WIDTH = 0.004;

/** A lane for each kind of event that happened; a motor has the colour of its rotor. */
export function eventLanes(flight: Pick<FlightPicture, "parts" | "start_s" | "end_s">): Lane[] {
  const width = WIDTH * (flight.end_s - flight.start_s);
  return EVENTS.flatMap(({ kind, name }) => {
    const events = flight.parts.events.filter((one) => one.kind === kind);
    if (events.length === 0) return [];
    const motors = kind === "saturated" || kind === "lost-rotor" || kind === "motor-off";
    const stretches: Stretch[] = events.map((one, place) => ({
      from: one.start_s, to: one.end_s, code: motors && one.output ? one.output : -1 - place,
    }));
    return [{
      name, stretches, least: width,
      words: (code: number) => (code > 0 ? (kind === "lost-rotor" ? `rotor ${code} lost` : `motor ${code} at its limit`) : (events[-1 - code]?.detail ?? name)),
      look: (code: number) => (kind === "gap" ? ("idle" as const) : code > 0 ? ("rotor" as const) : ("unknown" as const)),
    }];
  });
}

/** Duties in %, with points where one is saturated, above all others. */
export function outputLines(flight: Pick<FlightPicture, "outputs" | "output_limit">): { duty: Values; saturated: Values; output: number }[] {
  const limit = flight.output_limit - 0.005;
  const percent = (value: number | null) => (value === null ? null : 100 * value);
  return flight.outputs.map((one) => ({
    output: one.output,
    duty: one.mean.map(percent),
    // The highest sample of the bucket: a mean would hide a short saturation.
    saturated: one.high.map((high) => (high !== null && high >= limit ? 100 * high : null)),
  }));
}

/** The flight in a sentence: time in the air, and events. */
export function flightSentence(flight: FlightPicture): string {
  const air = flight.parts.parts.filter((one) => one.kind === "air" || one.kind === "unknown").reduce((sum, one) => sum + one.end_s - one.start_s, 0);
  const happened = EVENTS.flatMap(({ kind, name }) => {
    const events = flight.parts.events.filter((one) => one.kind === kind);
    return events.length > 0 ? [kind === "lost-rotor" ? (events[0]?.detail ?? name) : `${name}: ${events.length} ×`] : [];
  });
  const words = happened.length > 0 ? happened.join("; ") : flight.outputs.length > 0 ? "no motor at its limit, no jump of the estimator" : "no jump of the estimator; no motor outputs";
  return `${air.toFixed(1)} of ${(flight.end_s - flight.start_s).toFixed(1)} s in the air; ${words}.`;
}

/** Frequencies of the rotors as text; empty if the log has none. */
export function rotorSpeedWords(rotors: readonly { rotor: number; low_hz: number; median_hz: number; high_hz: number }[]): string {
  return rotors.map((one) => `rotor ${one.rotor} ${one.median_hz.toFixed(0)} Hz (${one.low_hz.toFixed(0)} to ${one.high_hz.toFixed(0)})`).join(", ");
}
