/** A campaign: many flights with statistics of the detectors. */
import { For, type JSX, Show, createMemo } from "solid-js";
import type { Schemas } from "../api/client";
import type { Narrowed } from "../api/narrowed";
import { duration, percent, short } from "../format";
import { type Points, type VerdictCount, cumulativeOn, seriesOn, verdictConfusion as confusionOfVerdicts } from "../model/campaign";
import { Figures, Panel } from "../parts/bits";
import { ConfusionTable } from "../parts/confusion";
import { Chart } from "../plots/chart";
import { seriesColour } from "../theme";
import { type ResultTable, ResultTables } from "./tables";

/** Of the flights of one value of an axis. */
type Score = Schemas["BriefSummary"];
/** Of all flights. */
type FullScore = Narrowed<Schemas["DetectorSummary"], { confusion_truth_verdict_windows: VerdictCount[] }>;
/** Our detectors; a report may have more, those of the user. */
type Scores<S> = Record<"sequential" | "t_test" | "network", S>;
type Axis = Narrowed<Schemas["AxisSummary"], { groups: Narrowed<Schemas["AxisValueSummary"], { detectors: Scores<Score> }>[] }>;
export type CampaignResult = Narrowed<Schemas["CampaignSummary"], { detectors: Scores<FullScore>; axes: Axis[] }>;
export const DETECTORS = [["sequential", "sequential"], ["t_test", "T-test"], ["network", "network"]] as const;
export type DetectorName = (typeof DETECTORS)[number][0];

/** Detectors that judged, with their scores: ours, then the user's own by name. */
function judgesOf<S extends { windows: number }>(scores: Scores<S>): { name: string; score: S }[] {
  const own = Object.entries(scores).filter(([key]) => key.startsWith("own_")).sort(([a], [b]) => a.localeCompare(b));
  const all = [...DETECTORS.map(([key, name]) => ({ name, score: scores[key] })), ...own.map(([key, score]) => ({ name: key.slice("own_".length).replaceAll("_", " "), score }))];
  return all.filter(({ score }) => score.windows > 0);
}

const verdictConfusion = (score: FullScore) => confusionOfVerdicts(score.confusion_truth_verdict_windows);

/** Selection: a detector, and a cell of its confusion matrix by the codes of its truth and verdicts. */
export interface Look {
  detector: DetectorName;
  truth?: number | undefined;
  verdicts?: readonly number[] | undefined;
}

export function CampaignView(props: { result: CampaignResult; look: Look; choose: (look: Look) => void; /** Of the cell that was chosen. */ flights?: JSX.Element }) {
  const it = () => props.result;
  const confusion = createMemo(() => verdictConfusion(it().detectors[props.look.detector]));
  const chosen = (): [number, number] | undefined => {
    const codes = confusion().codes;
    const row = codes?.truths.findIndex((all) => all[0] === props.look.truth) ?? -1;
    const column = codes?.names.findIndex((all) => all.join() === props.look.verdicts?.join()) ?? -1;
    return row < 0 || column < 0 ? undefined : [row, column];
  };
  const choose = (row: number, column: number) => {
    const again = chosen()?.[0] === row && chosen()?.[1] === column;
    props.choose({ detector: props.look.detector, ...(again ? {} : { truth: confusion().codes?.truths[row]?.[0], verdicts: confusion().codes?.names[column] }) });
  };
  return (
    <>
      <Panel title="Detectors over all flights">
        <div class="stack">
          <Figures items={[["flights", it().flights.toLocaleString("en")], ["failed", String(it().failed)], ["flown", `${short(it().flown_h)} h`], ["steps", it().steps.toLocaleString("en")]]} />
          <ScoreTable rows={[{ name: "all", scores: it().detectors }]} head="" />
        </div>
      </Panel>
      <Panel title="Confusion matrix" note="windows; row: true fault; column: verdict; a click on a cell lists its flights" actions={<Choice value={props.look.detector} choose={(detector) => props.choose({ detector })} />}>
        <ConfusionTable confusion={confusion()} corner="truth / verdict" what="windows" choose={choose} chosen={chosen()} />
      </Panel>
      {props.flights}
      <For each={it().axes}>
        {(axis) => (
          <Panel title={`By ${axis.axis}`}>
            <ScoreTable head={axis.axis} rows={axis.groups.map((group) => ({ name: group.value, scores: group.detectors, flights: group.flights }))} />
          </Panel>
        )}
      </For>
      <p class="small muted">Detection delay: from the fault to the first window with the correct verdict. [ ]: 95 % interval. Flown: {duration(3600 * it().flown_h)}.</p>
    </>
  );
}

function Choice(props: { value: DetectorName; choose: (value: DetectorName) => void }) {
  return (
    <span class="row" role="group" aria-label="detector">
      <For each={DETECTORS}>{([key, name]) => <button type="button" aria-pressed={props.value === key} onClick={() => props.choose(key)}>{name}</button>}</For>
    </span>
  );
}

function ScoreTable(props: { head: string; rows: readonly { name: string; scores: Scores<Score>; flights?: number }[] }) {
  return (
    <div class="scroll" tabindex="0" role="region" aria-label={`Scores by ${props.head || "detector"}`}>
      <table class="small">
        <thead>
          <tr>
            <th scope="col">{props.head}</th><th scope="col">detector</th><th class="r" scope="col">correct windows</th><th class="r" scope="col">fault flights isolated</th>
            <th class="r" scope="col">delay, median s</th><th class="r" scope="col">95 %, s</th><th class="r" scope="col">worst, s</th><th class="r" scope="col">false alarms</th><th class="r" scope="col">per healthy hour</th>
          </tr>
        </thead>
        <tbody>
          <For each={props.rows}>
            {(row) => (
              <For each={judgesOf(row.scores)}>
                {({ name, score }, place) => (
                  <tr>
                    <td>{place() === 0 ? row.name : ""}{place() === 0 && row.flights ? ` (${row.flights} flights)` : ""}</td>
                    <td>{name}</td>
                    <td class="r">{percent(score.right)} {score.right_95 ? `[${percent(score.right_95[0])}, ${percent(score.right_95[1])}]` : ""}</td>
                    <td class="r">{score.isolated.flights} of {score.fault_flights}</td>
                    <td class="r">{short(score.isolated.median_s)}</td>
                    <td class="r">{short(score.isolated.p95_s)}</td>
                    <td class="r">{short(score.isolated.worst_s)}</td>
                    <td class="r">{score.false_alarm_events}</td>
                    <td class="r">{score.healthy_h > 0 ? short(score.false_alarm_events / score.healthy_h) : "–"}</td>
                  </tr>
                )}
              </For>
            )}
          </For>
        </tbody>
      </table>
    </div>
  );
}

/** Additional contents of a campaign's report. */
export interface CampaignReport {
  name: string;
  description: string;
  seed: number;
  /** Planned flights. */
  planned: number;
  result: CampaignResult;
  tables: ResultTable[];
  /** For each detector the sorted delays to isolation and how many flights had been isolated by then, and the flights with a fault. */
  delays: { detector: string; fault_flights: number; delay_s: number[]; isolated: number[] }[];
  /** Median delay and false alarms per hour along the thresholds, for each severity. */
  operating: { severity: string; level: number[]; delay_s: number[]; alarms_per_h: number[] }[];
  facts: [string, string][];
  notes: string[];
}

export function CampaignReportView(props: { report: CampaignReport }) {
  const it = () => props.report;
  const delays = () => cumulativeOn(it().delays.map((one) => ({ x: one.delay_s, y: one.isolated.map((count) => (100 * count) / Math.max(1, one.fault_flights)) })));
  const operating = () => seriesOn(it().operating.map((one): Points => ({ x: one.delay_s, y: one.alarms_per_h })));
  const first = () => it().result.detectors.sequential;
  return (
    <>
      <p class="muted">{it().description} Seed {it().seed}.</p>
      <Show when={it().result.flights < it().planned}>
        <div class="say warn">{it().result.flights} of {it().planned} flights are there; the same command resumes.</div>
      </Show>
      <Panel title="Detectors over all flights">
        <div class="stack">
          <Figures
            items={[
              ["flights", it().result.flights.toLocaleString("en")],
              ["failed", String(it().result.failed)],
              ["flown", `${short(it().result.flown_h)} h`],
              ["correct windows, sequential", `${percent(first().right)}${first().right_95 ? ` [${percent(first().right_95?.[0])}, ${percent(first().right_95?.[1])}]` : ""}`],
              ["false alarms, sequential", String(first().false_alarm_events)],
              ["isolated after, median, sequential", `${short(first().isolated.median_s)} s`],
            ]}
          />
          <ScoreTable rows={[{ name: "all", scores: it().result.detectors }]} head="" />
        </div>
      </Panel>
      <Show when={delays().x.length > 1}>
        <Panel title="Delay to isolation" note="share of the flights with a fault whose rotor has been named">
          <Chart
            title="Flights isolated" unit="%" xLabel="delay from the onset to the correct verdict" xLog x={delays().x} height={260}
            lines={delays().y.map((values, k) => ({ label: it().delays[k]?.detector ?? "", values, colour: (["s1", "s2", "s4"] as const)[k] ?? "s8", step: true, width: 2 }))}
          />
        </Panel>
      </Show>
      <For each={judgesOf(it().result.detectors)}>
        {({ name, score }) => (
          <Panel title={`Confusion matrix, ${name}`} note="share of the windows of each truth; row: true fault; column: verdict">
            <ConfusionTable confusion={verdictConfusion(score)} corner="truth / verdict" shares />
          </Panel>
        )}
      </For>
      <Show when={operating().x.length > 0}>
        <Panel title="Operating curve" note="a point for each threshold; lost: share of the thrust">
          <Chart
            title="False alarms per hour" unit="1/h" xLabel="median delay to isolation" xLog x={operating().x} height={260}
            lines={operating().y.map((values, k) => ({ label: it().operating[k]?.severity ?? "", values, colour: seriesColour(k), joined: true, width: 2 }))}
          />
        </Panel>
      </Show>
      <ResultTables tables={it().tables} />
      <Panel title="How it was made">
        <dl class="facts"><For each={it().facts}>{([name, value]) => <><dt>{name}</dt><dd class="mono">{value}</dd></>}</For></dl>
        <ul class="small muted"><For each={it().notes}>{(one) => <li>{one}</li>}</For></ul>
      </Panel>
    </>
  );
}
