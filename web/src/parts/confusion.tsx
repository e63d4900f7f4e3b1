/** A confusion matrix as a table. */
import { For } from "solid-js";
import type { Confusion } from "../model/confusion";

export function ConfusionTable(props: { confusion: Confusion; corner: string }) {
  const most = () => Math.max(1, ...props.confusion.counts.flat());
  const wash = (count: number, right: boolean) => (count > 0 ? `color-mix(in srgb, var(--${right ? "good" : "bad"}-wash) ${40 + (60 * count) / most()}%, transparent)` : undefined);
  return (
    <div class="scroll" tabindex="0" role="region" aria-label="Confusion matrix">
      <table class="small confusion">
        <thead>
          <tr>
            <th scope="col">{props.corner}</th>
            <For each={props.confusion.names}>{(name) => <th scope="col" class="r">{name}</th>}</For>
          </tr>
        </thead>
        <tbody>
          <For each={props.confusion.truths}>
            {(truth, row) => (
              <tr>
                <th scope="row">{truth}</th>
                <For each={props.confusion.names}>
                  {(name, column) => {
                    const count = () => props.confusion.counts[row()]?.[column()] ?? 0;
                    return <td class="r" style={{ "background-color": wash(count(), truth === name) }}>{count() ? count().toLocaleString("en") : "·"}</td>;
                  }}
                </For>
              </tr>
            )}
          </For>
        </tbody>
      </table>
    </div>
  );
}
