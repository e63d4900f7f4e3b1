/** Flights of a campaign with windows in a cell of the confusion matrix; each opens as a run. */
import { For, Show, createEffect, createSignal, on } from "solid-js";
import { type Schemas, ask, get } from "../api/client";
import { createLoad } from "../api/load";
import { sentenceOf } from "../api/problem";
import { count, short, verdictText } from "../format";
import { Panel, Problem } from "../parts/bits";
import { navigate } from "../router";
import { DETECTORS, type Look } from "../shown/campaign";

type Flight = Schemas["CampaignFlight"];
const PAGE = 50;

export function CampaignFlights(props: { id: string; look: Look }) {
  const query = () => ({ detector: props.look.detector, truth: props.look.truth, verdict: props.look.verdicts?.join(",") });
  const cell = () => (props.look.truth === undefined ? undefined : JSON.stringify(query()));
  const [more, setMore] = createSignal<Flight[]>([]);
  const [next, setNext] = createSignal<string | null>();
  const [problem, setProblem] = createSignal<string>();
  const [opening, setOpening] = createSignal<number>();
  const page = async (cursor: string | undefined, signal?: AbortSignal) => {
    const found = await get("/api/v1/campaigns/{id}/flights", {
      path: { id: props.id }, query: { ...query(), limit: PAGE, cursor: cursor === undefined ? undefined : Number(cursor) }, ...(signal ? { signal } : {}),
    });
    setNext(found.next ?? null);
    return found.items;
  };
  const first = createLoad(cell, (_, signal) => page(undefined, signal));
  createEffect(on(cell, () => { setMore([]); setProblem(undefined); }));
  const rows = () => [...(first.data() ?? []), ...more()];
  const axes = () => rows()[0]?.parameters.map((one) => one.axis) ?? [];
  const attempt = async (what: () => Promise<void>) => {
    setProblem(undefined);
    try {
      await what();
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  const open = (flight: number) => attempt(async () => {
    setOpening(flight);
    try {
      const run = await ask<Schemas["Run"]>("POST", `/api/v1/campaigns/${props.id}/flights/${flight}/run`);
      navigate(`/runs/${run.id}?campaign=${props.id}&flight=${flight}`);
    } finally {
      setOpening(undefined);
    }
  });
  const detector = () => DETECTORS.find(([key]) => key === props.look.detector)?.[1] ?? "";
  const verdicts = () => ((props.look.verdicts?.length ?? 0) > 1 ? "several rotors" : verdictText(props.look.verdicts?.[0]));
  return (
    <Show when={cell()}>
      <Panel title={`Flights: ${props.look.truth === -1 ? "several rotors" : verdictText(props.look.truth)}, judged ${verdicts()}`} note={`${detector()}; a flight opens as a run, with its seed and scenario`}>
        <Problem sentence={problem() ?? first.error()} retry={first.reload} />
        <div class="scroll" tabindex="0" role="region" aria-label="Flights of the cell">
          <table class="small">
            <thead>
              <tr>
                <th class="r" scope="col">Flight</th><th scope="col">Run</th>
                <For each={axes()}>{(axis) => <th scope="col">{axis}</th>}</For>
                <th scope="col">Faulty</th><th class="r" scope="col">windows in this cell</th><th scope="col">verdict at end</th>
                <th class="r" scope="col">detected after, s</th><th class="r" scope="col">isolated after, s</th><th class="r" scope="col">false alarms</th><th scope="col">Run hash</th>
              </tr>
            </thead>
            <tbody>
              <For each={rows()} fallback={<tr><td colspan={9 + axes().length} class="muted">{first.loading() ? "Loading …" : "none"}</td></tr>}>
                {(one) => (
                  <tr>
                    <td class="r">{one.flight}</td>
                    <td>
                      <Show when={one.status !== "refused"} fallback="cannot be flown">
                        <button type="button" disabled={opening() !== undefined} aria-label={`Open flight ${one.flight} as a run`} onClick={() => void open(one.flight)}>
                          {opening() === one.flight ? "Opening …" : one.run ? "Open" : "Fly and open"}
                        </button>
                      </Show>
                    </td>
                    <For each={one.parameters}>{(parameter) => <td class="num">{typeof parameter.value === "number" && !Number.isInteger(parameter.value) ? short(parameter.value, 4) : String(parameter.value)}</td>}</For>
                    <td>{one.faulty_rotors.length === 0 ? "–" : `rotor ${one.faulty_rotors.join(", ")}${typeof one.fault_onset_s === "number" ? ` from ${short(one.fault_onset_s)} s` : ""}`}</td>
                    <td class="r">{one.windows.toLocaleString("en")}</td>
                    <td>{one.reason ? `${one.status}: ${one.reason}` : verdictText(one.verdict_at_end)}</td>
                    <td class="r">{short(one.detected_after_s)}</td>
                    <td class="r">{short(one.isolated_after_s)}</td>
                    <td class="r">{one.false_alarm_events}</td>
                    <td class="mono">{one.run_hash.slice(0, 8)}</td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
        <div class="row small muted">
          <span>{count(rows().length, "flight")} shown</span>
          <Show when={next()}>{(cursor) => <button type="button" onClick={() => void attempt(async () => { const items = await page(cursor()); setMore((before) => [...before, ...items]); })}>{PAGE} more</button>}</Show>
          <a href={`/runs?parent=${props.id}`}>Runs of this campaign's flights</a>
        </div>
      </Panel>
    </Show>
  );
}
