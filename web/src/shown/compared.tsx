/** A whole comparison, as its report shows it. */
import { type Accessor, For, createSignal } from "solid-js";
import { percent } from "../format";
import type { Load } from "../api/load";
import type { LogComparison, Series } from "../model/twin";
import { Panel } from "../parts/bits";
import { type Fall, Falls } from "../plots/falls";
import { type ComparisonReport, type Only, seriesOf, within } from "./compared-series";
import { ComparisonView, type Looks, OpenLoop, type Wanted } from "./comparison";

export function ComparedView(props: { report: ComparisonReport }) {
  const models = () => props.report.comparison.models;
  return (
    <>
      <p class="small muted">
        <For each={models()}>{(one, at) => <>{at() > 0 ? " · " : ""}<strong>{one.label}</strong> ({one.effects.join(", ") || "no effects"}; <code>{one.hash.slice(0, 8)}</code>)</>}</For>
      </p>
      <ComparedPanel title="Where and when it fails" report={props.report} />
      <For each={props.report.comparison.logs}>
        {(one) => (
          <Panel title={`How much: ${one.log.name}`} note={`${one.duration_s.toFixed(1)} s at ${one.rate_hz.toFixed(0)} Hz; root mean square of means over 0.1 s; the mark is what noise alone gives`}>
            <div class="falls"><For each={fallsOf(one)}>{(fall) => <Falls fall={fall} />}</For></div>
            <OpenLoop log={one} />
          </Panel>
        )}
      </For>
    </>
  );
}

/** Where and when: heat strips, channels and the flight over time. `lanes`: additional lanes on a log's time axis, by its name. */
export function ComparedPanel(props: { title: string; report: ComparisonReport; lanes?: Looks["lanes"] }) {
  const [log, chooseLog] = createSignal(0);
  const [channel, chooseChannel] = createSignal<string>();
  const series = (wanted: Accessor<Wanted>): Load<Series> => ({
    data: () => seriesOf(props.report, wanted().log, wanted().channel, only()),
    error: () => undefined,
    loading: () => false,
    reload: () => undefined,
  });
  const [condition, setCondition] = createSignal("");
  const [low, setLow] = createSignal("");
  const [high, setHigh] = createSignal("");
  const only = (): Only | undefined =>
    condition() === "" ? undefined : { condition: condition(), low: low() === "" ? -Infinity : Number(low()), high: high() === "" ? Infinity : Number(high()) };
  const pictures = () => props.report.pictures[log()];
  const share = () => {
    const shown = pictures();
    const counts = shown ? within(shown, only()) : [];
    return counts.filter(Boolean).length / Math.max(1, counts.length);
  };
  const conditions: Looks["conditions"] = (wanted) => ({
    data: () => {
      const of = props.report.pictures[wanted() ?? -1];
      return of && { ...of, items: of.conditions };
    },
    error: () => undefined,
    loading: () => false,
    reload: () => undefined,
  });
  const looks: Looks = { logAt: log, chooseLog, channel, chooseChannel, series, conditions, picture: (at) => props.report.flights?.[at], ...(props.lanes ? { lanes: props.lanes } : {}) };
  return (
    <Panel title={props.title}>
      <div class="stack">
        <fieldset class="row small screen">
          <legend class="sr">Only where a flight condition is within bounds</legend>
          <label class="row">
            plots over time only where
            <select value={condition()} onChange={(event) => setCondition(event.currentTarget.value)}>
              <option value="">(everywhere)</option>
              <For each={pictures()?.conditions ?? []}>{(one) => <option value={one.name}>{one.title}{one.unit ? `, ${one.unit}` : ""}</option>}</For>
            </select>
          </label>
          <label class="row">from <input type="number" step="any" value={low()} onInput={(event) => setLow(event.currentTarget.value)} /></label>
          <label class="row">to <input type="number" step="any" value={high()} onInput={(event) => setHigh(event.currentTarget.value)} /></label>
          <span class="muted" role="status">{only() ? `${percent(share(), 0)} of the time` : ""}</span>
        </fieldset>
        <ComparisonView result={props.report.comparison} looks={looks} />
      </div>
    </Panel>
  );
}

function fallsOf(log: LogComparison): Fall[] {
  return (log.models[0]?.errors ?? []).map((one) => ({
    title: one.quantity,
    unit: one.unit,
    noise: one.noise ?? null,
    rows: log.models.map((model) => ({ name: model.model.replace(/^.*[@/]/, ""), error: model.errors.find((other) => other.quantity === one.quantity)?.error ?? null })),
  }));
}
