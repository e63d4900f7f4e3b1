/** Cases of a blind bench in a cell of the confusion matrix: each with its truth and the diagnosis in full, and its log in the twin. */
import { For, Show, createEffect, createSignal, on } from "solid-js";
import { type Schemas, ask, get } from "../api/client";
import { createLoad } from "../api/load";
import { sentenceOf } from "../api/problem";
import { count, percent, short } from "../format";
import type { Diagnosis } from "../model/twin";
import { Panel, Problem } from "../parts/bits";
import { navigate, setQuery } from "../router";
import { OUTCOMES } from "../shown/blind";
import { DiagnosisView } from "../shown/diagnosis";

type Case = Schemas["BlindCase"];
const PAGE = 50;

/** What is looked at: a row and a column of the confusion matrix. */
export interface Cell {
  hidden: string;
  named: string;
}

/** `rotor-thrust-scale, rotor 3, from 20 s: share −0.08`. */
function effectText(effect: Schemas["HiddenEffect"]): string {
  const values = Object.entries(effect.parameters).map(([name, value]) => `${name} ${short(value, 4)}`);
  const where = [effect.id, effect.rotor ? `rotor ${effect.rotor}` : "", typeof effect.onset_s === "number" ? `from ${short(effect.onset_s)} s` : ""];
  return `${where.filter(Boolean).join(", ")}${values.length > 0 ? `: ${values.join(", ")}` : ""}`;
}
const effectsText = (effects: readonly Schemas["HiddenEffect"][]) => (effects.length === 0 ? "nothing" : effects.map(effectText).join("; "));

export function BlindCases(props: { id: string; cell: Cell | undefined; chosen: number | undefined }) {
  const cell = () => (props.cell ? JSON.stringify(props.cell) : undefined);
  const [more, setMore] = createSignal<Case[]>([]);
  const [next, setNext] = createSignal<string | null>();
  const [problem, setProblem] = createSignal<string>();
  const [opening, setOpening] = createSignal<number>();
  const page = async (cursor: string | undefined, signal?: AbortSignal) => {
    const found = await get("/api/v1/blind-benches/{id}/cases", {
      path: { id: props.id }, query: { ...props.cell, limit: PAGE, cursor: cursor === undefined ? undefined : Number(cursor) }, ...(signal ? { signal } : {}),
    });
    setNext(found.next ?? null);
    return found.items;
  };
  const first = createLoad(cell, (_, signal) => page(undefined, signal));
  createEffect(on(cell, () => { setMore([]); setProblem(undefined); }));
  const rows = () => [...(first.data() ?? []), ...more()];
  const attempt = async (what: () => Promise<void>) => {
    setProblem(undefined);
    try {
      await what();
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  const open = (one: Case) => attempt(async () => {
    setOpening(one.case);
    try {
      const log = await ask<Schemas["JobView"]>("POST", `/api/v1/blind-benches/${props.id}/cases/${one.case}/log`);
      navigate(`/twin?log=${log.id}&vehicle=${encodeURIComponent(one.vehicle)}`);
    } finally {
      setOpening(undefined);
    }
  });
  return (
    <Show when={props.cell}>
      {(shown) => (
        <>
          <Panel title={`Cases: hidden ${shown().hidden}, named ${shown().named}`} note="the log of a case is flown again with its seed, and opens in the twin">
            <Problem sentence={problem() ?? first.error()} retry={first.reload} />
            <div class="scroll" tabindex="0" role="region" aria-label="Cases of the cell">
              <table class="small">
                <thead>
                  <tr>
                    <th class="r" scope="col">Case</th><th scope="col">Truth and answer</th><th scope="col">Log</th><th scope="col">Preset</th><th scope="col">Vehicle</th><th scope="col">Flight</th>
                    <th scope="col">Hidden</th><th scope="col">Named</th><th scope="col">Outcome</th><th class="r" scope="col">ln evidence</th><th class="r" scope="col">parameter error</th><th class="r" scope="col">s</th>
                  </tr>
                </thead>
                <tbody>
                  <For each={rows()} fallback={<tr><td colspan="12" class="muted">{first.loading() ? "Loading …" : "none"}</td></tr>}>
                    {(one) => (
                      <tr>
                        <td class="r">{one.case}</td>
                        <td>
                          <button type="button" aria-pressed={props.chosen === one.case} aria-label={`Truth and answer of case ${one.case}`} onClick={() => setQuery({ case: props.chosen === one.case ? undefined : String(one.case) })}>Show</button>
                        </td>
                        <td>
                          <Show when={one.outcome !== "not-flown"} fallback="none: every flight was lost">
                            <button type="button" disabled={opening() !== undefined} aria-label={`Open the log of case ${one.case} in the twin`} onClick={() => void open(one)}>
                              {opening() === one.case ? "Opening …" : one.log ? "Open" : "Fly and open"}
                            </button>
                          </Show>
                        </td>
                        <td>{one.preset}</td><td>{one.vehicle}</td><td>{one.flight}</td>
                        <td class="break">{effectsText(one.effects)}</td>
                        <td>{one.failure ?? (one.answer || "nothing")}</td>
                        <td><span class={`tag ${OUTCOMES[one.outcome] ?? ""}`}>{one.outcome}</span></td>
                        <td class="r">{typeof one.evidence === "number" ? one.evidence.toFixed(1) : ""}</td>
                        <td class="r">{one.parameter_errors.length > 0 ? percent(Math.max(...one.parameter_errors), 2) : ""}</td>
                        <td class="r">{short(one.seconds)}</td>
                      </tr>
                    )}
                  </For>
                </tbody>
              </table>
            </div>
            <div class="row small muted">
              <span>{count(rows().length, "case")} shown</span>
              <Show when={next()}>{(cursor) => <button type="button" onClick={() => void attempt(async () => { const items = await page(cursor()); setMore((before) => [...before, ...items]); })}>{PAGE} more</button>}</Show>
            </div>
          </Panel>
          <Show when={props.chosen !== undefined}><OneCase id={props.id} number={props.chosen ?? 0} /></Show>
        </>
      )}
    </Show>
  );
}

/** What was hidden in a case, and what the diagnosis said of its log. */
function OneCase(props: { id: string; number: number }) {
  const load = createLoad(() => String(props.number), (_, signal) => get("/api/v1/blind-benches/{id}/cases/{case}", { path: { id: props.id, case: String(props.number) }, signal }));
  return (
    <>
      <Problem sentence={load.error()} retry={load.reload} />
      <Show when={load.data()}>
        {(one) => (
          <>
            <Panel title={`Truth of case ${one().case}`} note={`${one().preset}, ${one().flight}, seed ${one().seed}`}>
              <Show when={one().truth} fallback={<p>Every flight of this case was lost: nothing was diagnosed.</p>}>
                {(truth) => (
                  <dl class="facts">
                    <dt>hidden</dt><dd>{effectsText(truth().effects)}</dd>
                    <dt>besides</dt><dd>{one().clutter ? "small deviations of every other parameter" : "nothing"}</dd>
                    <dt>vehicle</dt><dd>{one().vehicle}</dd>
                    <dt>length</dt><dd>{short(truth().duration_s)} s</dd>
                    <dt>charge at the start</dt><dd>{percent(truth().state_of_charge, 0)}</dd>
                  </dl>
                )}
              </Show>
            </Panel>
            <Panel title={`Answer to case ${one().case}`} note={one().outcome}>
              <Show when={one().diagnosis} fallback={<p>{one().failure ?? "none"}</p>}>
                {(found) => <div class="stack"><DiagnosisView found={found() as Diagnosis} /></div>}
              </Show>
            </Panel>
          </>
        )}
      </Show>
    </>
  );
}
