/** Rotors that share an axis. */

type Rotor = { position_body_m: readonly number[] };

/** How many rotors on the axis of each one are above it; z points down, and of two at one height the later one is the lower. */
export function levels(rotors: readonly Rotor[]): number[] {
  const [x, y, z] = [0, 1, 2].map((axis) => (rotor: Rotor) => rotor.position_body_m[axis] ?? 0) as [Of, Of, Of];
  const reach = Math.max(0, ...rotors.map((rotor) => Math.hypot(x(rotor), y(rotor))));
  return rotors.map((rotor, number) => {
    const isAbove = (other: Rotor, its: number) => z(other) < z(rotor) || (z(other) === z(rotor) && its < number);
    return rotors.filter((other, its) => its !== number && Math.hypot(x(other) - x(rotor), y(other) - y(rotor)) < SAME_AXIS * reach && isAbove(other, its)).length;
  });
}

type Of = (rotor: Rotor) => number;

/** Rotors nearer to each other than this share of the longest arm share an axis. */
const SAME_AXIS = 0.05;
