/** One cursor and one interval for all plots of a page. */
import { type Accessor, createSignal } from "solid-js";

export interface View {
  /** Time of the cursor, s. */
  cursor: Accessor<number | undefined>;
  setCursor: (at: number | undefined) => void;
  /** Interval shown; undefined: all. */
  range: Accessor<readonly [number, number] | undefined>;
  setRange: (range: readonly [number, number] | undefined) => void;
  /** Intervals that are shaded, such as those with a fault. */
  shades?: Accessor<readonly (readonly [number, number])[]>;
}

export function createView(range?: readonly [number, number], shades?: View["shades"]): View {
  const [cursor, setCursor] = createSignal<number | undefined>();
  const [shown, setRange] = createSignal<readonly [number, number] | undefined>(range);
  return { cursor, setCursor: (at) => setCursor(at), range: shown, setRange: (next) => setRange(next), ...(shades ? { shades } : {}) };
}
