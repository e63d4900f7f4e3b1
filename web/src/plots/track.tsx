/** Ground track of a vehicle: north is up. A point follows the cursor; the track outside the interval shown is faint. */
import { For, Show, createMemo, createSignal, createUniqueId } from "solid-js";
import { short } from "../format";
import { type Values, extent, placeAt, samplePlaces } from "./series";
import type { View } from "./view";

interface Props {
  title: string;
  time: readonly number[];
  north: Values;
  east: Values;
  view?: View;
}

const SIZE = 240;
const EDGE = 12;
const TABLE_ROWS = 25;

export function Track(props: Props) {
  const id = createUniqueId();
  const [open, setOpen] = createSignal(false);
  const frame = createMemo(() => {
    const [north, east] = [extent(props.north), extent(props.east)];
    if (!north || !east) return undefined;
    // Equal scales, so that a circle is a circle.
    const reach = Math.max(north.largest - north.least, east.largest - east.least, 0.1);
    const scale = (SIZE - 2 * EDGE) / reach;
    const [middleNorth, middleEast] = [(north.least + north.largest) / 2, (east.least + east.largest) / 2];
    return { north, east, reach, at: (n: number, e: number) => [SIZE / 2 + (e - middleEast) * scale, SIZE / 2 - (n - middleNorth) * scale] as const };
  });
  const path = (from: number, to: number) => {
    const found = frame();
    if (!found) return "";
    let [text, pen] = ["", false];
    for (let place = from; place <= to; place += 1) {
      const [n, e] = [props.north[place], props.east[place]];
      if (typeof n !== "number" || typeof e !== "number") {
        pen = false;
        continue;
      }
      const [x, y] = found.at(n, e);
      text += `${pen ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
      pen = true;
    }
    return text;
  };
  const shown = () => {
    const range = props.view?.range();
    return range ? [placeAt(props.time, range[0]), placeAt(props.time, range[1])] as const : [0, props.time.length - 1] as const;
  };
  const cursor = () => {
    const at = props.view?.cursor();
    if (at === undefined) return undefined;
    const place = placeAt(props.time, at);
    const [n, e] = [props.north[place], props.east[place]];
    return typeof n === "number" && typeof e === "number" ? frame()?.at(n, e) : undefined;
  };
  const summary = () => {
    const found = frame();
    return found
      ? `north from ${short(found.north.least)} to ${short(found.north.largest)} m, east from ${short(found.east.least)} to ${short(found.east.largest)} m`
      : "no value";
  };
  const rows = createMemo(() => samplePlaces(props.time, props.view?.range(), TABLE_ROWS));
  return (
    <figure class="plot fig" aria-labelledby={`${id}-title`}>
      <div class="legend">
        <strong id={`${id}-title`}>{props.title}</strong>
        <span class="key">north is up, {short(frame()?.reach)} m across</span>
      </div>
      <svg class="track" viewBox={`0 0 ${SIZE} ${SIZE}`} role="img" aria-label={`${props.title}: ${summary()}`}>
        <path class="all" d={path(0, props.time.length - 1)} />
        <path class="shown" d={path(...shown())} />
        <Show when={cursor()}>{(at) => <circle cx={at()[0]} cy={at()[1]} r="4" />}</Show>
      </svg>
      <details onToggle={(event) => setOpen(event.currentTarget.open)}>
        <summary>Summary and table<span class="sr"> of {props.title}</span></summary>
        <Show when={open()}>
          <p class="sum">{summary()}</p>
          <div class="scroll" tabindex="0" role="region" aria-label={`Table of ${props.title}`}>
            <table class="small">
              <thead><tr><th class="r" scope="col">time, s</th><th class="r" scope="col">north, m</th><th class="r" scope="col">east, m</th></tr></thead>
              <tbody>
                <For each={rows()}>
                  {(place) => <tr><td class="r">{short(props.time[place], 5)}</td><td class="r">{short(props.north[place])}</td><td class="r">{short(props.east[place])}</td></tr>}
                </For>
              </tbody>
            </table>
          </div>
        </Show>
      </details>
    </figure>
  );
}
