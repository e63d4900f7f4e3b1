/** Verdicts over time, one lane each, with the true faults on top; below them a summary and a table. */
import { For, Index, Show, createMemo, createSignal, createUniqueId } from "solid-js";
import { count, short } from "../format";
import { seriesColour } from "../theme";
import { type Stretch } from "./series";
import type { View } from "./view";
import { laneText as words, laneWords } from "./words";

export interface Lane {
  name: string;
  stretches: readonly Stretch[];
  /** Text of a code, if it is not a verdict. */
  words?: (code: number) => string;
  /** Style of a code, if it is not a verdict. */
  look?: (code: number) => "idle" | "healthy" | "unknown" | "rotor";
  /** Drawn at least so wide, s, so that what is short is seen. */
  least?: number;
}

/** Rows of the table for each lane. */
const MOST_ROWS = 60;

interface Props {
  title: string;
  lanes: readonly Lane[];
  start: number;
  end: number;
  view?: View;
}

export function Lanes(props: Props) {
  const id = createUniqueId();
  const [open, setOpen] = createSignal(false);
  const summary = createMemo(() => laneWords(props.lanes));
  const from = () => props.view?.range()?.[0] ?? props.start;
  const to = () => props.view?.range()?.[1] ?? props.end;
  const share = (at: number) => (100 * (at - from())) / Math.max(1e-9, to() - from());
  const point = (event: MouseEvent & { currentTarget: HTMLElement }) => {
    const box = event.currentTarget.getBoundingClientRect();
    props.view?.setCursor(from() + ((event.clientX - box.left) / box.width) * (to() - from()));
  };
  return (
    <figure class="plot fig" aria-label={props.title} aria-describedby={`${id}-sum`}>
      <div class="lanes">
        {/* By place: while a flight goes on lanes and stretches are others a few times a second, and most look as before. */}
        <Index each={props.lanes}>
          {(lane) => (
            <>
              <span class="name">{lane().name}</span>
              <div class="lane" onMouseMove={point} onClick={point}>
                <Index each={lane().stretches}>
                  {(stretch) => {
                    const left = () => Math.max(0, share(stretch().from));
                    const right = () => Math.min(100, share(Math.max(stretch().to, stretch().from + (lane().least ?? 0))));
                    const said = () => words(lane(), stretch().code);
                    return (
                      <Show when={right() > left()}>
                        <i
                          class={(lane().look ?? kind)(stretch().code)}
                          title={`${lane().name}: ${said()}, ${short(stretch().from)} – ${short(stretch().to)} s`}
                          style={{
                            left: `${left()}%`,
                            width: `${right() - left()}%`,
                            "background-color": stretch().code > 0 ? `var(--${seriesColour(rotorOf(stretch().code) - 1)})` : undefined,
                          }}
                        >
                          <span>{said()}</span>
                        </i>
                      </Show>
                    );
                  }}
                </Index>
                <Show when={props.view?.cursor() !== undefined && share(props.view?.cursor() ?? 0) >= 0 && share(props.view?.cursor() ?? 0) <= 100}>
                  <b style={{ left: `${share(props.view?.cursor() ?? 0)}%` }} />
                </Show>
              </div>
            </>
          )}
        </Index>
      </div>
      <p class="sr" id={`${id}-sum`}>{summary()}</p>
      <details onToggle={(event) => setOpen(event.currentTarget.open)}>
        <summary>Summary and table<span class="sr"> of {props.title}</span></summary>
        <Show when={open()}>
          <p class="sum">{summary()}</p>
          <div class="scroll" tabindex="0" role="region" aria-label={`Table of ${props.title}`}>
            <table class="small">
              <thead><tr><th scope="col">lane</th><th class="r" scope="col">from, s</th><th class="r" scope="col">to, s</th><th scope="col">says</th></tr></thead>
              <tbody>
                <For each={props.lanes.flatMap((lane) => lane.stretches.slice(0, MOST_ROWS).map((stretch) => ({ lane, stretch })))}>
                  {(row) => (
                    <tr>
                      <td>{row.lane.name}</td>
                      <td class="r">{short(row.stretch.from, 4)}</td>
                      <td class="r">{short(row.stretch.to, 4)}</td>
                      <td>{words(row.lane, row.stretch.code)}</td>
                    </tr>
                  )}
                </For>
                <For each={props.lanes.filter((lane) => lane.stretches.length > MOST_ROWS)}>
                  {(lane) => <tr><td>{lane.name}</td><td colspan="3" class="muted">{count(lane.stretches.length - MOST_ROWS, "later row")} left out</td></tr>}
                </For>
              </tbody>
            </table>
          </div>
        </Show>
      </details>
    </figure>
  );
}

const rotorOf = (code: number) => (code >= 100 ? Math.floor(code / 100) : code);

function kind(code: number): string {
  if (code === -2 || code === -4) return "idle";
  if (code === 0) return "healthy";
  if (code < 0) return "unknown";
  return "rotor";
}
