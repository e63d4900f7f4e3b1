/**
 * Whether the server responds.
 *
 * A request without an answer calls [`lost`]; from then on `/healthz` is polled, at first every half second, later every five.
 * Code that needs the server waits for [`back`]. Pages that show data reload it when [`epoch`] increases.
 */
import { createSignal } from "solid-js";

const FIRST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 5000;
const PATIENCE_MS = 4000;

const [away, setAway] = createSignal(false);
const [epoch, setEpoch] = createSignal(0);
let waiting: (() => void)[] = [];

/** True while the server does not respond. */
export { away, epoch };

/** A request got no answer. */
export function lost(): void {
  if (away()) return;
  setAway(true);
  void look(FIRST_PAUSE_MS);
}

const returned = new Set<() => void>();

/** Calls `listener` whenever the server is back; returns a function that unsubscribes. */
export function onBack(listener: () => void): () => void {
  returned.add(listener);
  return () => void returned.delete(listener);
}

/** Resolves when the server responds again; immediately if it is not known to be down. */
export function back(): Promise<void> {
  if (!away()) return Promise.resolve();
  return new Promise((resolve) => waiting.push(resolve));
}

async function look(pause: number): Promise<void> {
  await new Promise((resolve) => setTimeout(resolve, pause));
  if (await answers()) {
    setAway(false);
    setEpoch((count) => count + 1);
    const all = waiting;
    waiting = [];
    for (const resolve of all) resolve();
    for (const listener of [...returned]) listener();
    return;
  }
  void look(Math.min(LONGEST_PAUSE_MS, pause * 1.5));
}

/** Polls once. */
export async function answers(): Promise<boolean> {
  try {
    const response = await fetch("/healthz", { signal: AbortSignal.timeout(PATIENCE_MS), cache: "no-store" });
    return response.ok;
  } catch {
    return false;
  }
}
