/** Verdicts over time, one lane each, with the true faults on top. */
import { For, Index, Show, createSignal } from "solid-js";
import { short, verdictText } from "../format";
import { seriesColour } from "../theme";
import { type Stretch } from "./series";
import type { View } from "./view";

export interface Lane {
  name: string;
  stretches: readonly Stretch[];
  /** Text of a code, if it is not a verdict. */
  words?: (code: number) => string;
  /** Style of a code, if it is not a verdict. */
  look?: (code: number) => "idle" | "healthy" | "unknown" | "rotor";
}

interface Props {
  title: string;
  lanes: readonly Lane[];
  start: number;
  end: number;
  view?: View;
}

export function Lanes(props: Props) {
  const [open, setOpen] = createSignal(false);
  const from = () => props.view?.range()?.[0] ?? props.start;
  const to = () => props.view?.range()?.[1] ?? props.end;
  const share = (at: number) => (100 * (at - from())) / Math.max(1e-9, to() - from());
  const words = (lane: Lane, code: number) => (lane.words ?? verdictText)(code);
  const point = (event: MouseEvent & { currentTarget: HTMLElement }) => {
    const box = event.currentTarget.getBoundingClientRect();
    props.view?.setCursor(from() + ((event.clientX - box.left) / box.width) * (to() - from()));
  };
  return (
    <figure class="plot fig" aria-label={props.title}>
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
                    const right = () => Math.min(100, share(stretch().to));
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
      <details onToggle={(event) => setOpen(event.currentTarget.open)}>
        <summary>Table<span class="sr"> of {props.title}</span></summary>
        <Show when={open()}>
          <div class="scroll" tabindex="0" role="region" aria-label={`Table of ${props.title}`}>
            <table class="small">
              <thead><tr><th scope="col">lane</th><th class="r" scope="col">from, s</th><th class="r" scope="col">to, s</th><th scope="col">says</th></tr></thead>
              <tbody>
                <For each={props.lanes.flatMap((lane) => lane.stretches.slice(0, 60).map((stretch) => ({ lane, stretch })))}>
                  {(row) => (
                    <tr>
                      <td>{row.lane.name}</td>
                      <td class="r">{short(row.stretch.from, 4)}</td>
                      <td class="r">{short(row.stretch.to, 4)}</td>
                      <td>{words(row.lane, row.stretch.code)}</td>
                    </tr>
                  )}
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
