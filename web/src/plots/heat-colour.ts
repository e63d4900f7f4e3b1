/** Colour of chi²/N by its logarithm: 1 is noise alone, which is inconspicuous on either background; 50 and more stands out most. */

type Stops = readonly (readonly [number, readonly [number, number, number]])[];
const LIGHT: Stops = [
  [1, [215, 234, 224]],
  [2, [250, 225, 150]],
  [5, [240, 165, 80]],
  [15, [205, 70, 60]],
  [50, [110, 15, 50]],
];
const DARK: Stops = [
  [1, [34, 58, 47]],
  [2, [104, 91, 38]],
  [5, [180, 110, 40]],
  [15, [232, 92, 70]],
  [50, [255, 170, 200]],
];

/** Values of the legend. */
export const HEAT_STEPS = [1, 2, 5, 15, 50] as const;

export function heatColour(value: number, dark = false): string {
  const stops = dark ? DARK : LIGHT;
  const first = stops[0];
  if (!first || value <= first[0]) return rgb(first?.[1] ?? [0, 0, 0]);
  for (let place = 1; place < stops.length; place += 1) {
    const [from, to] = [stops[place - 1], stops[place]];
    if (!from || !to || value > to[0]) continue;
    const share = Math.log(value / from[0]) / Math.log(to[0] / from[0]);
    return rgb(from[1].map((part, k) => Math.round(part + share * ((to[1][k] ?? 0) - part))));
  }
  return rgb(stops.at(-1)?.[1] ?? [0, 0, 0]);
}

const rgb = (parts: readonly number[]) => `rgb(${parts.join(", ")})`;
