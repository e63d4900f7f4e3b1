/** Tables that are texts already: a title, rows, and what to know when reading them. */
import { For, Show } from "solid-js";
import { Panel } from "../parts/bits";

export interface ResultTable {
  key: string;
  title: string;
  columns: string[];
  rows: string[][];
  notes: string[];
}

export function ResultTables(props: { tables: readonly ResultTable[] }) {
  return (
    <For each={props.tables}>
      {(table) => (
        <Panel title={table.title}>
          <div class="scroll" tabindex="0" role="region" aria-label={table.title}>
            <table class="small">
              <thead><tr><For each={table.columns}>{(column, k) => <th scope="col" class={isNumbers(table, k()) ? "r" : ""}>{column}</th>}</For></tr></thead>
              <tbody>
                <For each={table.rows}>
                  {(row) => (
                    <tr>
                      <For each={row}>
                        {(cell, k) => <td class={isNumbers(table, k()) ? "r" : isCommand(cell) ? "mono break" : ""} classList={{ below: k() === 0 && cell.startsWith(" ") }}>{cell.trim()}</td>}
                      </For>
                    </tr>
                  )}
                </For>
              </tbody>
            </table>
          </div>
          <Show when={table.notes.length > 0}><ul class="small muted"><For each={table.notes}>{(note) => <li>{note}.</li>}</For></ul></Show>
        </Panel>
      )}
    </For>
  );
}

const isCommand = (cell: string) => cell.startsWith("rotortwin ");
/** A column whose cells begin like numbers. */
const isNumbers = (table: ResultTable, place: number) => place > 0 && table.rows.every((row) => /^\s*([-−+±–—·]|\d|$|[<>≥≤] ?\d)/.test(row[place] ?? ""));
