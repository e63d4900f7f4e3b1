/** A run while it flies: its samples as they come, drawn as often as whoever looks can use. */
import { type Accessor, createEffect, createMemo, createSignal, on, onCleanup } from "solid-js";
import { watchLive } from "../api/live";
import { front, seen } from "../front";
import { Collector, type Samples, thinned } from "./run";

/** Pictures of plots are drawn so often, ms. */
const PLOT_MS = 250;
/** Plots take at most this share of the time, so that a click need not wait for them. */
const PLOT_SHARE = 0.2;
/** A page beside the one that somebody works with draws so often, ms, where pictures come late. */
const BESIDE_MS = 1000;
/** A picture comes late that the browser begins so long after it was asked for, ms. */
const LATE_MS = 60;
/** So many late ones in a row, and the pages beside step back for a while, ms; each time twice as long. */
const LATE_ONES = 3;
const STEP_BACK_MS = [15_000, 240_000] as const;
const LIVE_RATE_HZ = 40;
const LIVE_POINTS = 1600;

/**
 * Live samples: `frame` changes with every picture of the screen, `plots` a few times a second.
 *
 * Nothing comes while nobody sees the page; what flew meanwhile comes when it is seen again.
 */
export function createLive(run: string, active: Accessor<boolean>) {
  const empty: Samples = { time: [], data: {}, units: {} };
  const [frame, setFrame] = createSignal<Samples>(empty);
  const [plots, setPlots] = createSignal<Samples>(empty);
  const [lost, setLost] = createSignal(0);
  const [note, setNote] = createSignal<string>();
  const collector = new Collector();
  const wanted = createMemo(() => active() && seen());
  createEffect(
    on(wanted, (wanted) => {
      if (!wanted) return;
      let [asked, pictured, plotted, plotTook] = [0, -Infinity, -Infinity, 0];
      let [lateOnes, backUntil, stepBack] = [0, -Infinity, STEP_BACK_MS[0] as number];
      let pending = 0;
      let timer: ReturnType<typeof setTimeout> | undefined;
      const stepsBack = (now: number) => !front() && now < backUntil;
      const draw = (now: number) => {
        pending = 0;
        lateOnes = performance.now() - asked > LATE_MS ? lateOnes + 1 : 0;
        if (lateOnes >= LATE_ONES && now > backUntil) {
          backUntil = now + stepBack;
          stepBack = Math.min(STEP_BACK_MS[1], 2 * stepBack);
        }
        pictured = now;
        setFrame({ ...collector });
        if (now - plotted > Math.max(stepsBack(now) ? BESIDE_MS : PLOT_MS, plotTook / PLOT_SHARE)) {
          plotted = now;
          const before = performance.now();
          setPlots(thinned({ ...collector }, LIVE_POINTS));
          // The plots are drawn before this comes to its turn.
          queueMicrotask(() => (plotTook = performance.now() - before));
        }
      };
      const paint = () => {
        clearTimeout(timer);
        timer = undefined;
        if (pending) return;
        asked = performance.now();
        pending = requestAnimationFrame(draw);
      };
      const soon = () => {
        if (pending || timer !== undefined) return;
        const wait = stepsBack(performance.now()) ? pictured + BESIDE_MS - performance.now() : 0;
        if (wait > 0) timer = setTimeout(paint, wait);
        else paint();
      };
      createEffect(() => front() && timer !== undefined && paint());
      const stop = watchLive(run, "*", LIVE_RATE_HZ, collector.time.at(-1) ?? 0, (message) => {
        if (collector.take(message)) soon();
        if (message.type === "lost") setLost((before) => before + message.count);
        if (message.type === "error") setNote(message.detail);
        if (message.type === "history" && message.thinned) setNote("The oldest samples are thinned until the run has ended.");
      });
      onCleanup(() => {
        stop();
        clearTimeout(timer);
        cancelAnimationFrame(pending);
      });
    }),
  );
  return { frame, plots, lost, note };
}
