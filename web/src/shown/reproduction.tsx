/** The paper's tables and figures, reproduced. */
import { For, Show } from "solid-js";
import { Figures, Panel } from "../parts/bits";
import { type ResultTable, ResultTables } from "./tables";

export interface Reproduction {
  vehicle: string;
  rotor_count: number;
  world: string;
  seeds: number[];
  flights: number;
  hours: number;
  tables: ResultTable[];
  choices: [string, string][];
  /** Plots as SVG documents; `report` is the page of that flight, next to this file; none for a figure of the blades. */
  figures: { label: string; title: string; about: string; svg: string; report: string | null }[];
  facts: [string, string][];
  files: string[];
}

export function ReproductionView(props: { result: Reproduction }) {
  const it = () => props.result;
  return (
    <>
      <p class="muted">{it().vehicle} · {it().rotor_count} rotors · {it().world}{it().seeds.length > 0 ? ` · seeds ${it().seeds.join(", ")}` : ""}</p>
      <Show when={it().flights > 0}>
        <Panel title="What was flown"><Figures items={[["seeds (noise, lift biases, splits, initial weights)", String(it().seeds.length)], ["flights", it().flights.toLocaleString("en")], ["hours of flight", it().hours.toFixed(1)]]} /></Panel>
      </Show>
      <ResultTables tables={it().tables} />
      <Panel title="Choices the paper leaves open">
        <div class="scroll" tabindex="0" role="region" aria-label="Choices">
          <table class="small"><thead><tr><th scope="col">What</th><th scope="col">chosen</th></tr></thead><tbody><For each={it().choices}>{([what, choice]) => <tr><td>{what}</td><td>{choice}</td></tr>}</For></tbody></table>
        </div>
      </Panel>
      <Show when={it().figures.length > 0}><p class="small muted">Figures 9 to 17: reference flight, §6.1. The networks of these flights were trained without the trajectory that is flown.</p></Show>
      <For each={it().figures}>
        {(one) => (
          <Panel title={one.title} note={`paper, ${one.label}`}>
            <p>{one.about} <Show when={one.report}>{(report) => <a href={report()}>Interactive report of this flight</a>}</Show></p>
            <img class="paper" alt={`${one.title}. ${one.about}`} src={`data:image/svg+xml;charset=utf-8,${encodeURIComponent(one.svg)}`} />
          </Panel>
        )}
      </For>
      <Panel title="How it was made">
        <dl class="facts"><For each={it().facts}>{([name, value]) => <><dt>{name}</dt><dd class="mono">{value}</dd></>}</For></dl>
        <Show when={it().files.length > 0}><p class="small muted">In the same folder: {it().files.join(", ")}. The same command and program give the same numbers on every machine, with any number of threads.</p></Show>
      </Panel>
    </>
  );
}
