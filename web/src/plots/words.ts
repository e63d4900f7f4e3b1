/** What heat strips and lanes show, in a sentence: for who does not see the colours. */
import { count, short, verdictText } from "../format";
import type { HeatRow } from "./heat";
import type { Lane } from "./lanes";

/** So many rows of a heat strip, the largest first, and so many different words of a lane. */
const MOST_ROWS = 3;
const MOST_WORDS = 6;

/** The largest cell of the worst rows, and up to where the others are. */
export function heatWords(rows: readonly HeatRow[]): string {
  const tops = rows
    .flatMap((row) => {
      let place = -1;
      row.cells.forEach((value, at) => {
        if (value !== null && (place < 0 || value > (row.cells[place] ?? -Infinity))) place = at;
      });
      const value = row.cells[place];
      return value === null || value === undefined ? [] : [{ name: row.name, value, where: row.where(place) }];
    })
    .sort((a, b) => b.value - a.value);
  if (tops.length === 0) return "No cell has a value that counts.";
  const named = tops.slice(0, MOST_ROWS).map((one) => `${one.name} ${short(one.value)} at ${one.where}`);
  const rest = tops.slice(MOST_ROWS);
  const ending = rest[0] === undefined ? "" : ` The other ${count(rest.length, "channel reaches", "channels reach")} ${short(rest[0].value)} at most.`;
  return `chi²/N of ${count(tops.length, "channel")}; 1 is noise alone. Largest: ${named.join("; ")}.${ending}`;
}

/** Text of a code on a lane. */
export const laneText = (lane: Lane, code: number): string => (lane.words ?? verdictText)(code);

/** What each lane says, and when; what it says several times with its number and its first time. */
export function laneWords(lanes: readonly Lane[]): string {
  return lanes
    .map((lane) => {
      const said = new Map<string, { times: number; from: number; to: number }>();
      for (const one of lane.stretches) {
        const words = laneText(lane, one.code);
        const before = said.get(words);
        if (before) before.times += 1;
        else said.set(words, { times: 1, from: one.from, to: one.to });
      }
      const parts = [...said].map(([words, one]) =>
        one.times === 1 ? `${words} from ${short(one.from, 4)} to ${short(one.to, 4)} s` : `${words} ${one.times} times, first at ${short(one.from, 4)} s`,
      );
      const more = parts.length > MOST_WORDS ? `; and ${parts.length - MOST_WORDS} more` : "";
      return `${lane.name}: ${parts.slice(0, MOST_WORDS).join("; ") || "nothing"}${more}.`;
    })
    .join(" ");
}
