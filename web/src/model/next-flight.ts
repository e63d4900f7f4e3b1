/** The next flight to make if a flight cannot distinguish two effects. */
import type { Schemas } from "../api/client";
import type { Diagnosis } from "./twin";

export type Manoeuvre = Schemas["ProposedManoeuvre"];

export interface Candidate {
  /** The server's name for it: `rotor-thrust-scale#3`. */
  id: string;
  label: string;
}

const named = (effect: string, rotor: number | null | undefined, label: string): Candidate => ({
  id: rotor ? `${effect}#${rotor}` : effect,
  label: rotor && !label.includes(`rotor ${rotor}`) ? `${label}, rotor ${rotor}` : label,
});

/** Effects that the diagnosis cannot distinguish, best first. */
export function candidatesOf(found: Diagnosis): Candidate[] {
  const list = found.effects.flatMap((one) => [
    named(one.instance.effect, one.instance.rotor, one.label),
    ...one.also_compatible.map((rival) => named(rival.effect, rival.rotor, rival.label)),
  ]);
  return list.filter((one, place) => list.findIndex((other) => other.id === one.id) === place);
}

/** The scenario with a library vehicle in place of the file next to it. */
export function withVehicle(scenario: string, vehicle: string): string {
  return scenario.replace(/^vehicle = .*$/m, `vehicle = ${JSON.stringify(`../vehicles/${vehicle}.toml`)}`);
}
