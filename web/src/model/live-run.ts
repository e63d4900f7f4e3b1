/** A run in flight: its samples as they arrive, drawn as often as is useful. */
import { type Accessor, createEffect, createMemo, createSignal, on, onCleanup } from "solid-js";
import { watchLive } from "../api/live";
import { front, seen } from "../front";
import { Collector, type Samples, thinned } from "./run";

/** Interval at which plots are drawn, ms. */
const PLOT_MS = 250;
/** Largest share of the time for plots, so that clicks need not wait for them. */
const PLOT_SHARE = 0.2;
/** Drawing interval of a page next to the one in use, if frames are late, ms. */
const BESIDE_MS = 1000;
/** Delay after which a frame counts as late, ms. */
const LATE_MS = 60;
/** After this many late frames in a row the other pages slow down for a while, ms; each time twice as long. */
const LATE_ONES = 3;
const STEP_BACK_MS = [15_000, 240_000] as const;
const LIVE_RATE_HZ = 40;
const LIVE_POINTS = 1600;

/**
 * Live samples: `frame` changes with every frame of the screen, `plots` a few times a second.
 *
 * A hidden page gets nothing; the samples missed meanwhile arrive when it is visible again.
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
          // The plots are drawn before this runs.
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
