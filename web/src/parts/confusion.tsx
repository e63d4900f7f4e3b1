/** A confusion matrix as a table. */
import { For } from "solid-js";
import { percent } from "../format";
import type { Confusion } from "../model/confusion";

export function ConfusionTable(props: { confusion: Confusion; corner: string; /** Shares of each row instead of counts. */ shares?: boolean }) {
  const total = (row: number) => props.confusion.counts[row]?.reduce((sum, count) => sum + count, 0) ?? 0;
  const most = () => Math.max(1, ...props.confusion.counts.flat());
  const depth = (count: number, row: number) => count / (props.shares ? Math.max(1, total(row)) : most());
  const wash = (count: number, row: number, right: boolean) => (count > 0 ? `color-mix(in srgb, var(--${right ? "good" : "bad"}-wash) ${40 + 60 * depth(count, row)}%, transparent)` : undefined);
  return (
    <div class="scroll" tabindex="0" role="region" aria-label="Confusion matrix">
      <table class="small confusion">
        <thead>
          <tr>
            <th scope="col">{props.corner}</th>
            <For each={props.confusion.names}>{(name) => <th scope="col" class="r">{name}</th>}</For>
            {props.shares && <th scope="col" class="r">windows</th>}
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
                    return <td class="r" style={{ "background-color": wash(count(), row(), truth === name) }} title={`${count()} of ${total(row())}`}>{count() === 0 ? "·" : props.shares ? percent(count() / total(row())) : count().toLocaleString("en")}</td>;
                  }}
                </For>
                {props.shares && <td class="r muted">{total(row()).toLocaleString("en")}</td>}
              </tr>
            )}
          </For>
        </tbody>
      </table>
    </div>
  );
}
