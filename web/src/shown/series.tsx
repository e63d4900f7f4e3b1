/** One channel: measured against the model with the noise band, the residual, and the vehicle in 3-D at that time. */
import { type JSX, Show, createMemo, createSignal } from "solid-js";
import { channelTitle } from "../model/twin";
import { Problem } from "../parts/bits";
import { Chart } from "../plots/chart";
import type { Values } from "../plots/series";
import type { View } from "../plots/view";
import type { Looks } from "./comparison";

/** Height of the residual over time, and of what is beside it. */
export const RESIDUAL_PX = 190;

/** `children`: what is beside the residual, such as the residual over a flight condition. */
export function ChannelSeries(props: { looks: Looks; channel: string; model: string; view: View; children: JSX.Element }) {
  const series = props.looks.series(() => ({ channel: props.channel, log: props.looks.logAt(), range: props.view.range() }));
  const model = () => series.data()?.models.find((one) => one.label === props.model) ?? series.data()?.models.at(-1);
  const shifted = (values: Values | undefined, by: number): Values => (values ?? []).map((value) => (value === null ? null : value + by));
  const level = createMemo(() => (series.data()?.time_s ?? []).map(() => 2 * (series.data()?.noise.mean ?? 0)));
  const [flying, setFlying] = createSignal(false);
  return (
    <div class="stack">
      <Problem sentence={series.error() && `No picture of ${channelTitle(props.channel)}: ${series.error()}`} retry={series.reload} />
      <Show when={series.data()}>
        {(found) => (
          <>
            <Chart
              title={`${channelTitle(props.channel)}: measured and model`}
              unit={found().unit}
              x={found().time_s}
              view={props.view}
              bands={[{ label: "model, with noise of 2σ", low: shifted(model()?.predicted.mean, -2 * found().noise.mean), high: shifted(model()?.predicted.mean, 2 * found().noise.mean), colour: "s2" }]}
              lines={[
                { label: "measured", values: found().measured.mean, colour: "s1" },
                { label: model()?.label ?? "model", values: model()?.predicted.mean ?? [], colour: "s2" },
              ]}
              height={210}
            />
            <div class="side">
              <div>
                <Chart
                  title="Residual: measured − model"
                  unit={found().unit}
                  x={found().time_s}
                  view={props.view}
                  bands={[{ label: "noise, 2σ", low: level().map((one) => -one), high: level(), colour: "s3", opacity: 0.35 }]}
                  lines={[{ label: "mean of a bucket", values: model()?.residual.mean ?? [], colour: "s2" }]}
                  height={RESIDUAL_PX}
                />
                <p class="small muted">A bucket is {found().bucket_s.toPrecision(2)} s of samples: its mean is drawn, and the noise of that mean.<span class="screen"> Drag to zoom, double-click or Escape for all.</span></p>
              </div>
              {props.children}
            </div>
          </>
        )}
      </Show>
      <Show when={props.looks.flight}>
        {(flight) => (
          <details onToggle={(event) => setFlying(event.currentTarget.open)}>
            <summary>The vehicle in 3-D at that time</summary>
            <Show when={flying()}>{flight()(props.view)}</Show>
          </details>
        )}
      </Show>
    </div>
  );
}
