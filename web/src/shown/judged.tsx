/** Verdicts of the detectors on a log: the final one, verdicts over time, what was not judged and why, what the log lacks. */
import { For, Show } from "solid-js";
import type { Schemas } from "../api/client";
import { percent, short } from "../format";
import { Figures, Panel } from "../parts/bits";
import { type Lane, Lanes } from "../plots/lanes";
import type { Stretch } from "../plots/series";
import { createView } from "../plots/view";
import { DETECTORS } from "./campaign";
import { FlightLanes, FlightPlots } from "./flight";
import { type OverTime, OverTimeView } from "./over-time";

type Report = Schemas["LogReport"];
type Sequential = Schemas["SequentialView"];

/** A log compared with healthy flights; no outcome: it could not be. */
interface AgainstHealthy {
  outcome: "no_change" | "probably_changed" | "changed" | null;
  sentence: string;
}

/** Judged logs, as in the report of `fdi-log`. */
export type JudgedLogs = readonly { file: string; report: Report; over_time?: OverTime; against_healthy?: AgainstHealthy; score?: Schemas["LogScore"] }[];

export function JudgedView(props: { logs: JudgedLogs }) {
  return (
    <For each={props.logs}>
      {(one) => (
        <>
          <Panel title={one.file} note={one.report.detectors.vehicle}><Judged report={one.report} against={one.against_healthy} /></Panel>
          <Show when={one.score}>{(score) => <ScorePanel score={score()} />}</Show>
          <Show when={one.over_time}>{(data) => <OverTimeView data={data()} lanes={() => [verdictLane(one.report)]} />}</Show>
        </>
      )}
    </For>
  );
}

/** Detectors against the truth: how much they judged, and how much of that is correct. */
function ScorePanel(props: { score: Schemas["LogScore"] }) {
  const all = () => props.score.windows;
  const judges = () => props.score.detectors.filter((one) => one.windows > 0);
  return (
    <Panel title="Against the truth" note="Judged: of all windows of the log. Correct: of the judged ones.">
      <div class="scroll" tabindex="0" role="region" aria-label="Against the truth">
        <table class="small">
          <thead><tr><th scope="col">Detector</th><th class="r" scope="col">windows</th><th class="r" scope="col">judged</th><th class="r" scope="col">correct</th><th class="r" scope="col">false alarms</th></tr></thead>
          <tbody><For each={judges()}>{(one) => <tr><td>{nameOf(one.detector)}</td><td class="r">{all()}</td><td class="r">{percent(one.windows / all())}</td><td class="r">{percent(one.right / one.windows)}</td><td class="r">{one.false_alarm_events}</td></tr>}</For></tbody>
        </table>
      </div>
    </Panel>
  );
}

const nameOf = (detector: string) => DETECTORS.find(([key]) => key === detector)?.[1] ?? detector.replaceAll("_", " ");

export function Judged(props: { report: Report; against?: AgainstHealthy | undefined }) {
  const it = () => props.report;
  const last = () => it().final_window?.sequential;
  const view = createView();
  // Healthy within the flight is not healthy where the vehicle has changed since the healthy flights.
  const changed = () => ["changed", "probably_changed"].includes(props.against?.outcome ?? "");
  // Nor is it where the loss of a quarter of a rotor would not be seen.
  const hidesMuch = () => (it().final_window?.smallest_loss ?? []).some((loss) => loss > 0.25);
  return (
    <div class="stack">
      <Show when={changed() && props.against}>{(against) => <div class="say sentence bad" role="status"><strong>{against().outcome === "changed" ? "Changed" : "Probably changed"} since the healthy flights.</strong> {against().sentence}</div>}</Show>
      <Show when={last()}>{(word) => <div class={`say sentence ${word().verdict !== "healthy" ? "bad" : changed() || word().probability < 0.5 || hidesMuch() ? "" : "good"}`} role="status"><strong>{changed() ? "Within this flight:" : "Verdict:"}</strong> {it().sentence}</div>}</Show>
      <Show when={!last()}><div class="say sentence warn" role="status"><strong>Verdict:</strong> {it().sentence}</div></Show>
      <Figures items={[
        ["rows", it().log.rows.toLocaleString("en")], ["rate", `${short(it().log.rate_hz)} Hz${it().resampled ? ", resampled" : ""}`], ["length", `${short(it().log.duration_s)} s`],
        ["gaps", String(it().log.gaps)], ["rejected steps", String(it().rejected_steps)], ["judged", `${short(it().decided_s)} s`],
      ]} />
      <Show when={it().detectable}>{(words) => <p class="small">Detectable: {words()}.</p>}</Show>
      <Show
        when={it().flight}
        fallback={<Lanes title="Verdicts of the sequential detector" start={it().log.start_s} end={it().log.start_s + it().log.duration_s} lanes={[verdictLane(it())]} />}
      >
        {(flight) => <FlightLanes flight={flight()} view={view} more={[verdictLane(it())]} />}
      </Show>
      <div class="scroll" tabindex="0" role="region" aria-label="Detectors">
        <table class="small">
          <thead><tr><th scope="col">Detector</th><th class="r" scope="col">windows decided</th><th class="r" scope="col">healthy</th><th class="r" scope="col">alarms</th><th class="r" scope="col">first alarm, s</th></tr></thead>
          <tbody><For each={it().counts}>{(one) => <tr><td>{nameOf(one.detector)}</td><td class="r">{one.decided}</td><td class="r">{one.healthy}</td><td class="r">{one.alarms}</td><td class="r">{short(one.first_alarm_s)}</td></tr>}</For></tbody>
        </table>
      </div>
      <Show when={it().not_judged.length > 0}>
        <div class="scroll" tabindex="0" role="region" aria-label="Not judged">
          <table class="small">
            <thead><tr><th class="r" scope="col">not judged from, s</th><th class="r" scope="col">to, s</th><th scope="col">why</th></tr></thead>
            <tbody><For each={it().not_judged}>{(one) => <tr><td class="r">{short(one.from_s)}</td><td class="r">{short(one.to_s)}</td><td>{one.why.startsWith(one.reason) ? one.why : `${one.reason.replaceAll("_", " ")}: ${one.why}`}</td></tr>}</For></tbody>
          </table>
        </div>
      </Show>
      <For each={it().suspicions}>{(one) => <div class={`say ${one.blocks ? "bad" : "warn"}`}>{one.finding}</div>}</For>
      <For each={it().lacks}>{(one) => <div class={`say ${one.prevents_verdicts ? "bad" : "warn"}`}>Missing<Show when={one.columns.length > 0}> <code>{one.columns.join(", ")}</code></Show>: {one.rules_out}</div>}</For>
      <ul class="small"><For each={it().notes.filter((one) => !changed() || one !== props.against?.sentence)}>{(one) => <li>{one}</li>}</For></ul>
      <Show when={it().flight}>{(flight) => <FlightPlots flight={flight()} view={view} />}</Show>
    </div>
  );
}

/** Verdicts of the sequential detector on the log's time. */
function verdictLane(report: Report): Lane {
  const { start_s: start, duration_s: length } = report.log;
  const stretches = changesToStretches(report.timeline, length).map((one) => ({ ...one, from: one.from + start, to: one.to + start }));
  return { name: "verdict", stretches };
}

export function changesToStretches(changes: readonly Schemas["ChangeView"][], end: number): Stretch[] {
  return changes.map((change, k) => ({ from: change.time_s, to: changes[k + 1]?.time_s ?? end, code: change.sequential.code }));
}

/** The verdict as commands print it, with its probability. */
export function verdictWords(word: Sequential): string {
  return `${word.sentence} (probability ${percent(word.probability)})`;
}
