/** What to fly next, where a flight cannot tell two effects apart. */
import type { Diagnosis } from "./twin";

/** Natural logarithm of the Bayes factor that a manoeuvre is expected to give, if one of the two effects is true. */
interface Evidence {
  against_other: number;
  against_all: number;
  strongest_rival: string;
}
export interface Manoeuvre {
  manoeuvre: string;
  description: string;
  duration_s: number;
  first: Evidence;
  second: Evidence;
}

export interface Candidate {
  /** As the server names it: `rotor-thrust-scale#3`. */
  id: string;
  label: string;
}

const named = (effect: string, rotor: number | null | undefined, label: string): Candidate => ({
  id: rotor ? `${effect}#${rotor}` : effect,
  label: rotor && !label.includes(`rotor ${rotor}`) ? `${label}, rotor ${rotor}` : label,
});

/** Effects that the diagnosis cannot tell apart, best first. */
export function candidatesOf(found: Diagnosis): Candidate[] {
  const list = found.effects.flatMap((one) => [
    named(one.instance.effect, one.instance.rotor, one.label),
    ...one.also_compatible.map((rival) => named(rival.effect, rival.rotor, rival.label)),
  ]);
  return list.filter((one, place) => list.findIndex((other) => other.id === one.id) === place);
}

/** The scenario with a vehicle of the library in the place of the file beside it. */
export function withVehicle(scenario: string, vehicle: string): string {
  return scenario.replace(/^vehicle = .*$/m, `vehicle = ${JSON.stringify(`../vehicles/${vehicle}.toml`)}`);
}
