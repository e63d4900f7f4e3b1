/** Constants that were fitted to measurements of a test stand: rival structures, parameters with intervals, data, fit, residual. */
import { For, Show } from "solid-js";
import { short } from "../format";
import { Panel } from "../parts/bits";
import { Chart } from "../plots/chart";

interface FittedModel {
  name: string;
  equation: string;
  rmse: number;
  held_out_rmse: number;
  r2: number;
  aicc: number;
  lag_one_correlation: number;
  /** Source of the intervals. */
  intervals: string;
  parameters: { name: string; value: number; low: number | null; high: number | null }[];
  notes: string[];
}
/** Data and fit; `x`, `y` and `fitted` (of the best structure) by increasing x. */
export interface FitResult {
  kind: string;
  files: string[];
  points: number;
  models: FittedModel[];
  notes: string[];
  x_name: string;
  y_name: string;
  x: number[];
  y: number[];
  fitted: number[];
}

export function FitView(props: { fits: readonly FitResult[] }) {
  return (
    <>
      <p class="small muted">
        Rivals are ordered by AICc (ΔAICc above about 10: much worse). Held out: points that the fit did not see, in contiguous tenths, or one by one below 30 points. A lag-1
        correlation far from 0 means structure that the model lacks.
      </p>
      <For each={props.fits}>{(fit) => <One fit={fit} />}</For>
    </>
  );
}

function One(props: { fit: FitResult }) {
  const it = () => props.fit;
  const best = () => it().models[0];
  // Several values at one abscissa (thrust at several voltages) do not form a curve.
  const isCurve = () => it().x.every((at, k) => k === 0 || at !== it().x[k - 1]);
  return (
    <Panel title={`${it().kind} · ${it().files.join(", ")}`} note={`${it().points} points`}>
      <div class="stack">
        <ul class="small muted"><For each={it().notes}>{(note) => <li>{note}</li>}</For></ul>
        <div class="scroll" tabindex="0" role="region" aria-label={`Structures of ${it().kind}`}>
          <table class="small">
            <thead>
              <tr>
                <th scope="col">Structure</th><th class="r" scope="col">rmse</th><th class="r" scope="col">held out</th><th class="r" scope="col">R²</th><th class="r" scope="col">ΔAICc</th><th class="r" scope="col">lag-1</th>
                <th scope="col">parameter</th><th class="r" scope="col">value</th><th class="r" scope="col">95 % interval</th><th scope="col">intervals from</th>
              </tr>
            </thead>
            <tbody>
              <For each={it().models}>
                {(model, place) => (
                  <For each={model.parameters}>
                    {(one, k) => (
                      <tr>
                        <Show when={k() === 0}>
                          <td rowspan={model.parameters.length}><strong>{model.name}</strong> <Show when={place() === 0}><span class="tag good">best</span></Show><br />{model.equation}</td>
                          <td class="r" rowspan={model.parameters.length}>{short(model.rmse, 4)}</td>
                          <td class="r" rowspan={model.parameters.length}>{short(model.held_out_rmse, 4)}</td>
                          <td class="r" rowspan={model.parameters.length}>{model.r2.toFixed(5)}</td>
                          <td class="r" rowspan={model.parameters.length}>{(model.aicc - (best()?.aicc ?? 0)).toFixed(1)}</td>
                          <td class="r" rowspan={model.parameters.length}>{short(model.lag_one_correlation, 2)}</td>
                        </Show>
                        <td><code>{one.name}</code></td>
                        <td class="r">{short(one.value, 4)}</td>
                        <td class="r">{one.low === null ? "−∞" : short(one.low, 4)} … {one.high === null ? "∞" : short(one.high, 4)}</td>
                        <Show when={k() === 0}><td rowspan={model.parameters.length}>{[model.intervals, ...model.notes].join("; ")}</td></Show>
                      </tr>
                    )}
                  </For>
                )}
              </For>
            </tbody>
          </table>
        </div>
        <Show when={best()}>
          {(model) => (
            <div class="two">
              <Chart
                title={it().y_name} unit="" xLabel={it().x_name} xUnit="" x={it().x} height={270}
                lines={[
                  { label: "measured", values: it().y, colour: "s1", points: true },
                  { label: model().name, values: it().fitted, colour: "s2", width: 2, points: !isCurve() },
                ]}
              />
              <Chart
                title={`Residual of ${model().name}`} unit="" xLabel={it().x_name} xUnit="" x={it().x} height={270}
                lines={[{ label: `measured − fitted, ${it().y_name}`, values: it().y.map((value, k) => value - (it().fitted[k] ?? NaN)), colour: "s1", points: true }]}
              />
            </div>
          )}
        </Show>
      </div>
    </Panel>
  );
}
