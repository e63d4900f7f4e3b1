/** Runs compared in numbers, like `rotortwin controllers`. */
export function Compared(props: { id: string; others: readonly string[] }) {
  const compared = createLoad(
    () => (props.others.length > 0 ? [props.id, ...props.others].join(",") : undefined),
    (runs, signal) => get("/api/v1/controllers", { query: { runs }, signal }),
  );
  return (
    <Show when={props.others.length > 0}>
      <Panel title="The flights in numbers" note="tracking, energy, what the fault did, what was seen of it">
        <Problem sentence={compared.error()} retry={compared.reload} />
        <Show when={compared.data()} fallback={<Show when={compared.loading()}><p class="muted">Comparing …</p></Show>}>
          {(found) => <Controllers compared={found()} names={found().rows.map((row) => (row.run === props.id ? "this run" : `run ${row.run.slice(0, 12)}`))} link={(run) => `/runs/${run}`} />}
        </Show>
      </Panel>
    </Show>
  );
}

/** Any channel of a run, together with the same one of other runs, and their difference. */
import { For, Show, createMemo, createSignal } from "solid-js";
import { get } from "../api/client";
import { createLoad } from "../api/load";
import { type Samples, samplesOf } from "../model/run";
import { Panel, Problem } from "../parts/bits";
import { Chart, type Line } from "../plots/chart";
import { linearAt } from "../plots/series";
import type { View } from "../plots/view";
import { Controllers } from "../shown/controllers";
import { seriesColour } from "../theme";

const POINTS = 1600;

export function Overlay(props: { id: string; others: readonly string[]; samples: Samples | undefined; view: View }) {
  const [channel, setChannel] = createSignal("true_position_north_m");
  const names = createMemo(() => Object.keys(props.samples?.units ?? {}).filter((name) => name !== "time_s").join("\n"));
  const unit = () => props.samples?.units[channel()] ?? "";
  const others = createLoad(
    () => (props.others.length > 0 ? { ids: props.others, channel: channel(), range: props.view.range() } : undefined),
    (wanted, signal) => Promise.all(wanted.ids.map((id) => samplesOf(id, wanted.channel, POINTS, wanted.range, signal))),
  );
  const x = () => props.samples?.time ?? [];
  // All resampled to the times of this run, so that they can be subtracted.
  const aligned = createMemo(() => (others.data() ?? []).map((other) => x().map((at) => (at > (other.time.at(-1) ?? -1) ? null : linearAt(other.time, other.data[channel()] ?? [], at)))));
  const mine = () => props.samples?.data[channel()] ?? [];
  const lines = (): Line[] => [
    { label: "this run", values: mine(), colour: "s1" },
    ...aligned().map((values, k) => ({ label: `run ${props.others[k]?.slice(0, 12) ?? ""}`, values, colour: seriesColour(k + 1), dash: [6, 3] })),
  ];
  const differences = (): Line[] =>
    aligned().map((values, k) => ({
      label: `run ${props.others[k]?.slice(0, 12) ?? ""} − this`,
      values: values.map((value, at) => (value === null || typeof mine()[at] !== "number" ? null : value - (mine()[at] as number))),
      colour: seriesColour(k + 1),
    }));
  return (
    <Show when={x().length > 0}>
      <Panel
        title={props.others.length > 0 ? "Compared with other runs" : "Any channel"}
        actions={
          <label class="row small">
            channel
            <select value={channel()} onChange={(event) => setChannel(event.currentTarget.value)}>
              <For each={names().split("\n")}>{(name) => <option value={name} selected={name === channel()}>{name}</option>}</For>
            </select>
          </label>
        }
      >
        <Problem sentence={others.error()} retry={others.reload} />
        <Chart title={channel()} unit={unit()} x={x()} view={props.view} lines={lines()} />
        <Show when={aligned().length > 0}><Chart title="Difference" unit={unit()} x={x()} view={props.view} lines={differences()} height={140} /></Show>
      </Panel>
    </Show>
  );
}
