/** A blind bench: what was hidden, what was named, and how often that was right. */
import { For, type JSX, Show, createMemo } from "solid-js";
import type { Schemas } from "../api/client";
import type { Narrowed } from "../api/narrowed";
import { count, percent, short } from "../format";
import { confusionOf } from "../model/confusion";
import { Panel } from "../parts/bits";
import { ConfusionTable } from "../parts/confusion";

type Share = Schemas["BlindShare"];
/** Median and 90 % or worst. */
type Pair = [number, number];
type Group = Narrowed<Schemas["BlindGroup"], { parameter_error?: Pair | null; chi2_after?: Pair | null; seconds: Pair }>;
export type BlindResult = Narrowed<Schemas["BlindSheet"], { groups: Group[] }>;

const shareText = (share: Share) => (share.of === 0 ? "–" : `${share.count} of ${share.of}: ${percent(share.share)} [${percent(share.low, 0)}, ${percent(share.high, 0)}]`);

export function BlindView(props: { result: BlindResult; /** Row and column that are looked at. */ cell?: { hidden: string; named: string } | undefined; choose: (cell: { hidden: string; named: string } | undefined) => void; /** Of that cell. */ cases?: JSX.Element }) {
  const confusion = createMemo(() => confusionOf(props.result.confusion));
  const chosen = (): [number, number] | undefined => {
    const [row, column] = [confusion().truths.indexOf(props.cell?.hidden ?? ""), confusion().names.indexOf(props.cell?.named ?? "")];
    return row < 0 || column < 0 ? undefined : [row, column];
  };
  const choose = (row: number, column: number) => {
    const again = chosen()?.[0] === row && chosen()?.[1] === column;
    props.choose(again ? undefined : { hidden: confusion().truths[row] ?? "", named: confusion().names[column] ?? "" });
  };
  return (
    <>
      <Panel title="Score" note="[ ]: 95 % interval">
        <div class="scroll" tabindex="0" role="region" aria-label="Score by group">
          <table class="small">
            <thead><tr><th scope="col">Group</th><th class="r" scope="col">cases</th><th class="r" scope="col">right, or not testable</th><th class="r" scope="col">first place right</th><th class="r" scope="col">exactly right</th><th class="r" scope="col">false alarms</th><th class="r" scope="col">confidently wrong</th><th class="r" scope="col">intervals hold the truth</th><th class="r" scope="col">median, s</th></tr></thead>
            <tbody>
              <For each={props.result.groups}>
                {(group) => (
                  <tr>
                    <td>{group.name}</td><td class="r">{group.cases}</td><td class="r">{shareText(group.right_or_not_testable)}</td><td class="r">{shareText(group.top1)}</td><td class="r">{shareText(group.exact)}</td>
                    <td class="r">{shareText(group.false_alarms)}</td><td class="r">{shareText(group.confidently_wrong)}</td><td class="r">{shareText(group.coverage)}</td><td class="r">{short(group.seconds[0])}</td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
      </Panel>
      <Panel title="Confusion matrix" note="cases; row: what was hidden; column: what was named; the diagonal is right; a click on a cell lists its cases">
        <ConfusionTable confusion={confusion()} corner="hidden / named" what="cases" choose={choose} chosen={chosen()} />
      </Panel>
      {props.cases}
    </>
  );
}

/** Additional contents of a bench's report. */
export interface BlindReport {
  request: { version: string; presets: string[]; n: number; seed: number; vehicles: string[]; duration_s: number };
  sheet: BlindResult;
  rows: {
    case: { index: number; preset: string; flight: string; seed: number };
    /** Arguments of the generator. */
    hidden: string;
    outcome: string;
    named: string;
    evidence: number | null;
    parameter_errors: (number | null)[];
    seconds: number;
    failure: string | null;
  }[];
}

const SHARES: readonly (readonly [string, keyof Group & ("right_or_not_testable" | "top1" | "all_found" | "exact" | "in_group" | "not_testable" | "missed" | "confidently_wrong" | "wrong_flagged" | "false_alarms" | "flagged" | "coverage" | "onset_within_1_s")])[] = [
  ["right, or correctly not testable", "right_or_not_testable"],
  ["first name right", "top1"],
  ["all hidden effects found", "all_found"],
  ["exactly the hidden set", "exact"],
  ["within the named group", "in_group"],
  ["correctly not testable", "not_testable"],
  ["missed", "missed"],
  ["confidently wrong", "confidently_wrong"],
  ["wrong, flagged as uncertain", "wrong_flagged"],
  ["false alarms", "false_alarms"],
  ["outside the catalogue, and said so", "flagged"],
  ["95 % intervals that cover the truth", "coverage"],
  ["onset within 1 s", "onset_within_1_s"],
];
/** How an outcome is coloured. */
export const OUTCOMES: Record<string, string> = { right: "good", flagged: "good", "in-group": "warn", "wrong-flagged": "warn", missed: "warn", "confidently-wrong": "bad", "false-alarm": "bad", failed: "bad" };

export function BlindReportView(props: { report: BlindReport }) {
  const it = () => props.report.request;
  return (
    <>
      <p class="muted">
        {count(props.report.rows.length, "case")} of {it().presets.join(", ")}; seed {it().seed}; flights of {it().duration_s} s; vehicles {it().vehicles.join(", ")}; rotortwin {it().version}.
        {" "}Logs come from a simulator that shares no code with the diagnosis; the diagnosis saw the log and the nominal vehicle only. Intervals are 95 % (Wilson).
        {" "}“Correctly not testable”: nothing was named, and the answer's own table of smallest detectable sizes says that this size would not have shown.
      </p>
      <For each={props.report.sheet.groups}>
        {(group) => (
          <Panel title={group.name} note={count(group.cases, "case")}>
            <div class="scroll" tabindex="0" role="region" aria-label={`Score of ${group.name}`}>
              <table class="small">
                <thead class="sr"><tr><th scope="col">what</th><th scope="col">share</th><th scope="col">picture</th></tr></thead>
                <tbody>
                  <For each={SHARES.filter(([, key]) => group[key].of > 0)}>
                    {([name, key]) => (
                      <tr>
                        <td>{name}</td><td class="num">{shareText(group[key])}</td>
                        <td><span class="interval" aria-hidden="true"><i style={{ left: `${100 * group[key].low}%`, width: `${100 * (group[key].high - group[key].low)}%` }} /><b style={{ left: `${100 * group[key].share}%` }} /></span></td>
                      </tr>
                    )}
                  </For>
                  <Show when={group.parameter_error}>{(error) => <tr><td>parameter error</td><td class="num" colspan="2">{percent(error()[0], 2)} median, {percent(error()[1], 2)} at 90 %</td></tr>}</Show>
                  <Show when={group.chi2_after}>{(chi2) => <tr><td>chi²/N of right answers (1: the oracle's)</td><td class="num" colspan="2">{chi2()[0].toFixed(4)} median, {chi2()[1].toFixed(4)} worst</td></tr>}</Show>
                  <tr><td>seconds per diagnosis</td><td class="num" colspan="2">{short(group.seconds[0])} median, {short(group.seconds[1])} worst</td></tr>
                </tbody>
              </table>
            </div>
          </Panel>
        )}
      </For>
      <Panel title="What was named for what">
        <div class="scroll" tabindex="0" role="region" aria-label="What was named for what">
          <table class="small">
            <thead><tr><th scope="col">hidden</th><th scope="col">named</th><th class="r" scope="col">cases</th></tr></thead>
            <tbody><For each={props.report.sheet.confusion}>{([truth, named, cases]) => <tr><td>{truth}</td><td>{named} <Show when={truth === named}><span class="tag good">right</span></Show></td><td class="r">{cases}</td></tr>}</For></tbody>
          </table>
        </div>
      </Panel>
      <Panel title="Every case">
        <div class="scroll" tabindex="0" role="region" aria-label="Every case">
          <table class="small">
            <thead><tr><th class="r" scope="col">case</th><th scope="col">preset</th><th scope="col">flight</th><th class="r" scope="col">seed</th><th scope="col">hidden</th><th scope="col">named</th><th scope="col">outcome</th><th class="r" scope="col">ln evidence</th><th class="r" scope="col">parameter error</th><th class="r" scope="col">s</th></tr></thead>
            <tbody>
              <For each={props.report.rows}>
                {(row) => (
                  <tr>
                    <td class="r">{row.case.index}</td><td>{row.case.preset}</td><td>{row.case.flight}</td><td class="r">{row.case.seed}</td>
                    <td class="break">{row.hidden}</td><td>{row.failure ?? row.named}</td><td><span class={`tag ${OUTCOMES[row.outcome] ?? ""}`}>{row.outcome}</span></td>
                    <td class="r">{row.evidence === null ? "" : row.evidence.toFixed(1)}</td><td class="r">{largest(row.parameter_errors)}</td><td class="r">{row.seconds.toFixed(2)}</td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
      </Panel>
    </>
  );
}

function largest(errors: readonly (number | null)[]): string {
  const known = errors.filter((one): one is number => one !== null);
  return known.length === 0 ? "" : percent(Math.max(...known), 2);
}
