/** One channel: measured against the model with the noise band, the residual, and the vehicle in 3-D at that time. */
import { Show, createMemo, createSignal } from "solid-js";
import { ask } from "../../api/client";
import { createLoad } from "../../api/load";
import { type Series, channelTitle } from "../../model/twin";
import type { Samples } from "../../model/run";
import { samplesOf } from "../../model/run";
import { Problem } from "../../parts/bits";
import { Chart } from "../../plots/chart";
import type { View } from "../../plots/view";
import { type Geometry, LOG_CHANNELS, MOTION_CHANNELS } from "../../replay/motion";
import { Replay } from "../../replay/replay";
import type { Values } from "../../plots/series";
import type { Twin } from "./state";

const BUCKETS = 800;

export function ChannelSeries(props: { twin: Twin; channel: string; model: string; view: View; duration: number }) {
  const series = createLoad(
    () => {
      const id = props.twin.comparison.result() && props.twin.comparison.job()?.id;
      return id ? { id, channel: props.channel, log: props.twin.logAt(), range: props.view.range() } : undefined;
    },
    ({ id, channel, log, range }, signal) => {
      const query = new URLSearchParams({ log: String(log), channel, points: String(BUCKETS) });
      if (range) {
        query.set("from_s", String(range[0]));
        query.set("to_s", String(range[1]));
      }
      return ask<Series>("GET", `/api/v1/comparisons/${id}/series?${query}`, undefined, { signal });
    },
  );
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
              bands={[{ label: "model ± 2σ of noise", low: shifted(model()?.predicted.mean, -2 * found().noise.mean), high: shifted(model()?.predicted.mean, 2 * found().noise.mean), colour: "s2" }]}
              lines={[
                { label: "measured", values: found().measured.mean, colour: "s1" },
                { label: model()?.label ?? "model", values: model()?.predicted.mean ?? [], colour: "s2" },
              ]}
              height={210}
            />
            <Chart
              title="Residual: measured − model"
              unit={found().unit}
              x={found().time_s}
              view={props.view}
              bands={[
                { label: "lowest to highest sample", low: model()?.residual.low ?? [], high: model()?.residual.high ?? [], colour: "s8", opacity: 0.18 },
                { label: "± 2σ of noise", low: level().map((one) => -one), high: level(), colour: "s3", opacity: 0.35 },
              ]}
              lines={[{ label: "mean of the bucket", values: model()?.residual.mean ?? [], colour: "s2" }]}
              height={170}
            />
            <p class="small muted">Buckets of {found().bucket_s.toPrecision(2)} s. Drag to zoom, double-click or Escape for all.</p>
          </>
        )}
      </Show>
      <details onToggle={(event) => setFlying(event.currentTarget.open)}>
        <summary>The vehicle in 3-D at that time</summary>
        <Show when={flying()}><Flight twin={props.twin} view={props.view} /></Show>
      </details>
    </div>
  );
}

function Flight(props: { twin: Twin; view: View }) {
  const geometry = createLoad(() => props.twin.vehicle(), (name, signal) => ask<Geometry>("GET", `/api/v1/vehicles/${encodeURIComponent(name)}/geometry`, undefined, { signal }));
  const track = createLoad(
    () => ({ log: [...props.twin.logs(), ...props.twin.held()][props.twin.logAt()], run: props.twin.runs()[0] }),
    async ({ log, run }, signal): Promise<Samples> => {
      if (log === undefined) return samplesOf(run ?? "", MOTION_CHANNELS, 4000, undefined, signal);
      const query = new URLSearchParams({ channels: LOG_CHANNELS, points: "4000" });
      const answer = await ask<{ data: Record<string, Values>; units: Record<string, string> }>("GET", `/api/v1/logs/${log}/telemetry?${query}`, undefined, { signal });
      return { time: (answer.data["time_s"] ?? []) as number[], data: answer.data, units: answer.units };
    },
  );
  return (
    <>
      <Problem sentence={geometry.error() ?? track.error()} retry={() => { geometry.reload(); track.reload(); }} />
      <Show when={geometry.data()} keyed>
        {(vehicle) => <Show when={track.data()}>{(found) => <Replay geometry={vehicle} track={found()} view={props.view} live={false} />}</Show>}
      </Show>
    </>
  );
}
