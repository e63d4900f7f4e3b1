/** How an error decreases over the versions of a model, with the floor due to noise: bars that are a table, each with its number beside it. */
import { For, Show } from "solid-js";
import { short } from "../format";

export interface Fall {
  title: string;
  unit: string;
  noise: number | null;
  rows: readonly { name: string; error: number | null }[];
}

export function Falls(props: { fall: Fall }) {
  const most = () => Math.max(1e-12, props.fall.noise ?? 0, ...props.fall.rows.map((row) => row.error ?? 0));
  const share = (value: number | null) => Math.min(100, (100 * (value ?? 0)) / most());
  const words = () =>
    `${props.fall.title}: ${props.fall.rows.map((row) => `${row.name} ${short(row.error)} ${props.fall.unit}`).join(", ")}${props.fall.noise === null ? "" : `; noise alone gives ${short(props.fall.noise)} ${props.fall.unit}`}`;
  return (
    <figure class="fig" aria-label={words()}>
      <h3>{props.fall.title}, {props.fall.unit}</h3>
      <div class="bars" role="table" aria-label={`${props.fall.title}, ${props.fall.unit}`}>
        <For each={props.fall.rows}>
          {(row, place) => (
            <div role="row">
              <span role="rowheader">{row.name}</span>
              <span class="track" aria-hidden="true">
                <i classList={{ last: place() > 0 && place() === props.fall.rows.length - 1 }} style={{ width: `${share(row.error)}%` }} />
                <Show when={props.fall.noise !== null}><b style={{ left: `calc(${share(props.fall.noise)}% - 1px)` }} /></Show>
              </span>
              <span class="num" role="cell">{short(row.error)}{ratio(row.error, props.fall.noise)}</span>
            </div>
          )}
        </For>
        <Show when={props.fall.noise !== null}>
          <div role="row">
            <span class="muted" role="rowheader">noise alone</span>
            <span class="track" aria-hidden="true"><b style={{ left: `calc(${share(props.fall.noise)}% - 1px)` }} /></span>
            <span class="num muted" role="cell">{short(props.fall.noise)}</span>
          </div>
        </Show>
      </div>
    </figure>
  );
}

const ratio = (error: number | null, noise: number | null) => (error === null || noise === null || noise <= 0 ? "" : ` (${(error / noise).toFixed(2)} × noise)`);
