/** The 3-D replay with its controls: play, scrub, speed; follows the shared cursor, or the flight while it is live. */
import { For, Show, createEffect, createMemo, createSignal, on, onCleanup, onMount } from "solid-js";
import { percent } from "../format";
import { placeAt } from "../plots/series";
import type { View } from "../plots/view";
import { colour, dark } from "../theme";
import { type Geometry, type Track, poseAt, prefixOf } from "./motion";
import type { Colours, Scene } from "./scene";

/** Points of the trail. */
const TRAIL = 400;
/** Interval at which the state of a moving vehicle is described in words, s. */
const TOLD_S = 0.5;
const SPEEDS = [0.25, 1, 2, 5] as const;

interface Props {
  geometry: Geometry;
  track: Track;
  ghost?: Track | undefined;
  view: View;
  live: boolean;
}

export function Replay(props: Props) {
  let holder!: HTMLDivElement;
  const [scene, setScene] = createSignal<Scene>();
  const [failure, setFailure] = createSignal<string>();
  const [playing, setPlaying] = createSignal(false);
  const [speed, setSpeed] = createSignal(1);
  const [following, setFollowing] = createSignal(true);

  const start = () => props.track.time[0] ?? 0;
  const end = () => props.track.time.at(-1) ?? 0;
  const at = () => Math.min(end(), Math.max(start(), props.view.cursor() ?? (props.live ? end() : start())));

  onMount(() => {
    let made: Scene | undefined;
    let gone = false;
    import("./scene").then(
      (module) => {
        if (gone) return;
        try {
          made = new module.Scene(holder, props.geometry, palette());
        } catch (error) {
          setFailure(`This browser cannot draw in 3-D (WebGL): ${error instanceof Error ? error.message : String(error)}`);
          return;
        }
        setScene(made);
      },
      () => setFailure("The 3-D part of the page could not be loaded."),
    );
    const observer = new ResizeObserver(() => made?.resize());
    observer.observe(holder);
    onCleanup(() => {
      gone = true;
      observer.disconnect();
      made?.dispose();
    });
  });

  createEffect(on([scene, dark], ([made]) => made?.paint(palette())));
  createEffect(() => scene()?.setFollow(following()));
  // In a live flight the paths grow with every frame; once a second is enough for those away from the vehicle.
  const whole = createMemo(() => (props.live ? Math.floor(end()) : props.track));
  createEffect(on([scene, whole, () => props.ghost], ([made]) => {
    if (!made) return;
    made.paths(pathOf(props.track, "reference_"), props.ghost ? pathOf(props.ghost, `${prefixOf(props.ghost)}position_`) : []);
  }));
  const pose = createMemo(() => poseAt(props.track, props.geometry, at()));
  createEffect(() => {
    const made = scene();
    const now = pose();
    if (!made || !now) return;
    made.show(now, pathOf(props.track, `${prefixOf(props.track)}position_`, at()), props.ghost ? poseAt(props.ghost, props.geometry, at()) : undefined);
  });

  let frame = 0;
  createEffect(() => {
    if (!playing()) return;
    let before = performance.now();
    const step = (now: number) => {
      const next = at() + ((now - before) / 1000) * speed();
      before = now;
      props.view.setCursor(Math.min(end(), next));
      if (next >= end() && !props.live) {
        setPlaying(false);
        return;
      }
      frame = requestAnimationFrame(step);
    };
    frame = requestAnimationFrame(step);
    onCleanup(() => cancelAnimationFrame(frame));
  });
  const toggle = () => {
    if (!playing() && at() >= end() - 1e-6) props.view.setCursor(start());
    setPlaying(!playing());
  };
  // In motion nobody reads forty sentences a second, and each costs layout and painting.
  const moving = () => playing() || (props.live && props.view.cursor() === undefined);
  const told = createMemo(() => (moving() ? Math.max(start(), Math.floor(at() / TOLD_S) * TOLD_S) : at()));
  const words = createMemo(() => {
    const now = poseAt(props.track, props.geometry, told());
    if (!now) return "No sample yet.";
    const [north, east, down] = now.position;
    const lossy = props.geometry.rotors.filter((_, k) => (now.loss[k] ?? 0) > 0).map((rotor) => `rotor ${rotor.number} ${percent(now.loss[rotor.number - 1] ?? 0)}`);
    return `At ${told().toFixed(2)} s: ${metres(north)} north, ${metres(east)} east, ${metres(-down)} high. ${lossy.length > 0 ? `Estimated loss of thrust: ${lossy.join(", ")}.` : "No rotor is named."}`;
  });

  return (
    <figure class="fig replay" aria-label="3-D replay">
      <div class="stage" ref={holder} role="img" aria-label={`3-D picture of the flight. ${words()}`}>
        <Show when={!scene() && !failure()}><p class="muted">Loading the 3-D part …</p></Show>
        <Show when={failure()}><p class="say warn">{failure()}</p></Show>
      </div>
      <div class="row player">
        <button type="button" onClick={toggle}>{playing() ? "Pause" : "Play"}</button>
        <input
          class="grow"
          type="range"
          aria-label="time of the replay, s"
          min={start()}
          max={end()}
          step="0.02"
          value={at()}
          onInput={(event) => props.view.setCursor(event.currentTarget.valueAsNumber)}
        />
        <span class="num">{at().toFixed(2)} s</span>
        <label class="check small">
          speed
          <select value={speed()} onChange={(event) => setSpeed(Number(event.currentTarget.value))}>
            <For each={SPEEDS}>{(one) => <option value={one} selected={one === 1}>× {one}</option>}</For>
          </select>
        </label>
        <label class="check small"><input type="checkbox" checked={following()} onChange={(event) => setFollowing(event.currentTarget.checked)} /> camera follows</label>
        <Show when={props.live && props.view.cursor() !== undefined}>
          <button type="button" onClick={() => { setPlaying(false); props.view.setCursor(undefined); }}>Back to now</button>
        </Show>
      </div>
      <p class="small muted">{words()}</p>
      <div class="legend small muted">
        <span class="key"><i class="swatch" style={{ "background-color": "var(--s1)" }} /> flown</span>
        <span class="key"><i class="swatch" style={{ "background-color": "var(--s2)" }} /> reference; arrows: thrust, hover is 1.1 arm lengths</span>
        <span class="key"><i class="swatch box" style={{ "background-color": "var(--good)" }} /> no loss</span>
        <span class="key"><i class="swatch box" style={{ "background-color": "var(--warn)" }} /> suspect, small loss</span>
        <span class="key"><i class="swatch box" style={{ "background-color": "var(--bad)" }} /> 25 % and more</span>
        <Show when={props.ghost}><span class="key"><i class="swatch" style={{ "background-color": "var(--s4)" }} /> ghost: the other run</span></Show>
        <span>Vehicle drawn 2.5 times its size; a square is 1 m.</span>
      </div>
    </figure>
  );
}

/** Rounded to 1 cm; a hover is not 10⁻²⁵ m from its point. */
const metres = (value: number) => `${(Math.round(100 * value) / 100 || 0).toFixed(2).replace("-", "−")} m`;

function palette(): Colours {
  return {
    background: colour("raised"), grid: colour("line"), body: colour("s8"), good: colour("good"), warn: colour("warn"), bad: colour("bad"),
    trail: colour("s1"), reference: colour("s2"), ghost: colour("s4"),
  };
}

/** Points of a path up to a time, at most [`TRAIL`]. */
function pathOf(track: Track, prefix: string, until = Infinity): [number, number, number][] {
  const [north, east, down] = ["north_m", "east_m", "down_m"].map((name) => track.data[prefix + name] ?? []);
  const last = until === Infinity ? track.time.length - 1 : placeAt(track.time, until);
  const step = Math.max(1, Math.ceil(last / TRAIL));
  const points: [number, number, number][] = [];
  for (let k = 0; k <= last; k += step) {
    const [n, e, d] = [north?.[k], east?.[k], down?.[k]];
    if (typeof n === "number" && typeof e === "number" && typeof d === "number") points.push([n, e, d]);
  }
  return points;
}
