/** Verdicts of the detectors on a log: the final one, verdicts over time, what was not judged and why, what the log lacks. */
import { For, Show } from "solid-js";
import type { Schemas } from "../api/client";
import { percent, plusMinus, short } from "../format";
import { Figures, Panel } from "../parts/bits";
import { type Lane, Lanes } from "../plots/lanes";
import type { Stretch } from "../plots/series";
import { createView } from "../plots/view";
import { DETECTORS } from "./campaign";
import { FlightLanes, FlightPlots } from "./flight";
import { type OverTime, OverTimeView } from "./over-time";

type Report = Schemas["LogReport"];
type Sequential = Schemas["SequentialView"];

/** Judged logs, as in the report of `fdi-log`. */
export type JudgedLogs = readonly { file: string; report: Report; over_time?: OverTime }[];

export function JudgedView(props: { logs: JudgedLogs }) {
  return (
    <For each={props.logs}>
      {(one) => (
        <>
          <Panel title={one.file} note={one.report.detectors.vehicle}><Judged report={one.report} /></Panel>
          <Show when={one.over_time}>{(data) => <OverTimeView data={data()} lanes={() => [verdictLane(one.report)]} />}</Show>
        </>
      )}
    </For>
  );
}

export function Judged(props: { report: Report }) {
  const it = () => props.report;
  const last = () => it().final_window?.sequential;
  const view = createView();
  return (
    <div class="stack">
      <Show when={last()}>{(word) => <div class={`say sentence ${word().verdict === "healthy" ? "good" : "bad"}`} role="status"><strong>At the end:</strong> {verdictWords(word())}</div>}</Show>
      <Figures items={[
        ["rows", it().log.rows.toLocaleString("en")], ["rate", `${short(it().log.rate_hz)} Hz${it().resampled ? ", resampled" : ""}`], ["length", `${short(it().log.duration_s)} s`],
        ["gaps", String(it().log.gaps)], ["rejected steps", String(it().rejected_steps)], ["calibrated", `${short(it().detectors.calibration_start_s)} – ${short(it().detectors.calibration_end_s)} s`],
      ]} />
      <Show
        when={it().flight}
        fallback={<Lanes title="Verdicts of the sequential detector" start={it().log.start_s} end={it().log.start_s + it().log.duration_s} lanes={[verdictLane(it())]} />}
      >
        {(flight) => <FlightLanes flight={flight()} view={view} more={[verdictLane(it())]} />}
      </Show>
      <div class="scroll" tabindex="0" role="region" aria-label="Detectors">
        <table class="small">
          <thead><tr><th scope="col">Detector</th><th class="r" scope="col">windows decided</th><th class="r" scope="col">healthy</th><th class="r" scope="col">alarms</th><th class="r" scope="col">first alarm, s</th></tr></thead>
          <tbody><For each={it().counts}>{(one) => <tr><td>{DETECTORS.find(([key]) => key === one.detector)?.[1] ?? one.detector}</td><td class="r">{one.decided}</td><td class="r">{one.healthy}</td><td class="r">{one.alarms}</td><td class="r">{short(one.first_alarm_s)}</td></tr>}</For></tbody>
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
      <ul class="small"><For each={it().notes}>{(one) => <li>{one}</li>}</For></ul>
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

/** Verdict with probability and losses. */
export function verdictWords(word: Sequential): string {
  const losses = word.thrust_loss.map((one) => `rotor ${one.rotor} lost ${plusMinus(100 * one.share, 50 * (one.share_high - one.share_low), "%")} of its thrust`);
  const suspects = word.thrust_loss.length === 0 && word.suspect_rotors.length > 0 ? `; rotors in question: ${word.suspect_rotors.join(", ")}` : "";
  return `${word.verdict.replaceAll("_", " ")} (probability ${percent(word.probability)})${losses.length > 0 ? `: ${losses.join(", ")}` : suspects}.`;
}
