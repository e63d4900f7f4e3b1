/** Colour of chi²/N by its logarithm: 1 is noise alone, 50 and more is the darkest. */

const STOPS: readonly (readonly [number, readonly [number, number, number]])[] = [
  [1, [215, 234, 224]],
  [2, [250, 225, 150]],
  [5, [240, 165, 80]],
  [15, [205, 70, 60]],
  [50, [110, 15, 50]],
];

/** Values of the legend. */
export const HEAT_STEPS = [1, 2, 5, 15, 50] as const;

export function heatColour(value: number): string {
  const first = STOPS[0];
  if (!first || value <= first[0]) return rgb(first?.[1] ?? [0, 0, 0]);
  for (let place = 1; place < STOPS.length; place += 1) {
    const [from, to] = [STOPS[place - 1], STOPS[place]];
    if (!from || !to || value > to[0]) continue;
    const share = Math.log(value / from[0]) / Math.log(to[0] / from[0]);
    return rgb(from[1].map((part, k) => Math.round(part + share * ((to[1][k] ?? 0) - part))));
  }
  return rgb(STOPS.at(-1)?.[1] ?? [0, 0, 0]);
}

const rgb = (parts: readonly number[]) => `rgb(${parts.join(", ")})`;
