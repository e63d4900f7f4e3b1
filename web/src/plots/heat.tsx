/** A heat map: channel over time or over a flight condition. Each cell is a button with its value in words; below it a summary, and the same as a table. */
import { For, Show, createMemo, createSignal, createUniqueId } from "solid-js";
import { short } from "../format";
import { dark } from "../theme";
import { HEAT_STEPS, heatColour } from "./heat-colour";
import { heatWords } from "./words";

export interface HeatRow {
  name: string;
  /** chi²/N; null: not counted. */
  cells: readonly (number | null)[];
  /** Meaning of a cell, in words. */
  where: (place: number) => string;
}

interface Props {
  title: string;
  rows: readonly HeatRow[];
  /** Text below column k; empty: none. */
  tick: (place: number) => string;
  axis: string;
  chosen?: { row: number; cell: number } | undefined;
  onPick: (row: number, cell: number) => void;
}

export function Heat(props: Props) {
  const id = createUniqueId();
  const columns = () => Math.max(1, ...props.rows.map((row) => row.cells.length));
  const summary = createMemo(() => heatWords(props.rows));
  return (
    <figure class="plot fig" aria-label={props.title} aria-describedby={`${id}-sum`}>
      <div class="scroll heatbox">
        <div class="heat" style={{ "grid-template-columns": `max-content repeat(${columns()}, minmax(4px, 1fr))` }}>
          <For each={props.rows}>
            {(row, at) => (
              <>
                <span class="name" classList={{ on: props.chosen?.row === at() }}>{row.name}</span>
                <For each={Array.from({ length: columns() }, (_, cell) => cell)}>
                  {(cell) => (
                    <Show
                      when={row.cells[cell] !== null && row.cells[cell] !== undefined}
                      fallback={<span class="cell none" title={`${row.name}, ${row.where(cell)}: does not count`} />}
                    >
                      <button
                        type="button"
                        class="cell"
                        tabindex={cell === 0 || (props.chosen?.row === at() && props.chosen.cell === cell) ? 0 : -1}
                        aria-pressed={props.chosen?.row === at() && props.chosen.cell === cell}
                        aria-label={`${row.name}, ${row.where(cell)}: chi²/N ${short(row.cells[cell])}`}
                        title={`${row.name}, ${row.where(cell)}: chi²/N ${short(row.cells[cell])}`}
                        style={{ "background-color": heatColour(row.cells[cell] ?? 1, dark()) }}
                        onClick={() => props.onPick(at(), cell)}
                        onKeyDown={walk}
                      />
                    </Show>
                  )}
                </For>
              </>
            )}
          </For>
          <span class="name">{props.axis}</span>
          <For each={Array.from({ length: columns() }, (_, cell) => cell)}>{(cell) => <span class="tick">{props.tick(cell)}</span>}</For>
        </div>
      </div>
      <div class="scale">
        chi²/N
        <For each={HEAT_STEPS}>
          {(step) => <><i style={{ "background-color": heatColour(step, dark()) }} /> {step}</>}
        </For>
        <span>(1: noise alone)</span>
      </div>
      <p class="sr" id={`${id}-sum`}>{summary()}</p>
      <Numbers rows={props.rows} title={props.title} summary={summary()} />
    </figure>
  );
}

/** The summary, and every cell that counts as a row of a table. */
function Numbers(props: { rows: readonly HeatRow[]; title: string; summary: string }) {
  const [open, setOpen] = createSignal(false);
  const cells = () => props.rows.flatMap((row) => row.cells.flatMap((value, place) => (value === null ? [] : [{ name: row.name, where: row.where(place), value }])));
  return (
    <details class="screen" onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>Summary and table<span class="sr"> of {props.title}</span></summary>
      <Show when={open()}>
        <p class="sum">{props.summary}</p>
        <div class="scroll" tabindex="0" role="region" aria-label={`Table of ${props.title}`}>
          <table class="small">
            <thead><tr><th scope="col">Channel</th><th scope="col">where</th><th class="r" scope="col">chi²/N</th></tr></thead>
            <tbody><For each={cells()}>{(one) => <tr><td>{one.name}</td><td>{one.where}</td><td class="r">{short(one.value)}</td></tr>}</For></tbody>
          </table>
        </div>
      </Show>
    </details>
  );
}

/** Arrow keys move from cell to cell. */
function walk(event: KeyboardEvent & { currentTarget: HTMLElement }): void {
  const grid = event.currentTarget.parentElement;
  if (!grid) return;
  const all = [...grid.querySelectorAll<HTMLButtonElement>("button.cell")];
  const box = event.currentTarget.getBoundingClientRect();
  const at = all.indexOf(event.currentTarget as HTMLButtonElement);
  const column = (element: HTMLElement) => Math.abs(element.getBoundingClientRect().left - box.left) < 2;
  const next = {
    ArrowRight: () => all[at + 1],
    ArrowLeft: () => all[at - 1],
    ArrowDown: () => all.slice(at + 1).find(column),
    ArrowUp: () => all.slice(0, at).reverse().find(column),
  }[event.key];
  if (!next) return;
  event.preventDefault();
  next()?.focus();
}
