/** A confusion matrix as a table; cells with details can be selected. */
import { For, type JSX, Show } from "solid-js";
import { percent } from "../format";
import type { Confusion } from "../model/confusion";

export function ConfusionTable(props: {
  confusion: Confusion;
  corner: string;
  /** Shares of each row instead of counts. */
  shares?: boolean;
  /** For a cell with a count. */
  choose?: (row: number, column: number) => void;
  /** Row and column. */
  chosen?: readonly [number, number] | undefined;
  /** Unit of the counts: "windows". */
  what?: string;
}) {
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
                    const text = () => (count() === 0 ? "·" : props.shares ? percent(count() / total(row())) : count().toLocaleString("en"));
                    const isChosen = () => props.chosen?.[0] === row() && props.chosen[1] === column();
                    return (
                      <td class="r" style={{ "background-color": wash(count(), row(), truth === name) }} title={`${count()} of ${total(row())}`}>
                        <Show when={props.choose && count() > 0} fallback={text()}>
                          <Cell chosen={isChosen()} label={`${count().toLocaleString("en")} ${props.what ?? ""}: ${props.corner.replace(" / ", ` ${truth}, `)} ${name}`} onClick={() => props.choose?.(row(), column())}>{text()}</Cell>
                        </Show>
                      </td>
                    );
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

function Cell(props: { chosen: boolean; label: string; onClick: () => void; children: JSX.Element }) {
  return <button type="button" class="cell" aria-pressed={props.chosen} aria-label={props.label} onClick={() => props.onClick()}>{props.children}</button>;
}
