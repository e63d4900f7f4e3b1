/** Campaigns: many flights with statistics of the detectors. */
import { For, Show, createMemo, createSignal } from "solid-js";
import { type Schemas, ask } from "../api/client";
import { ApiError, sentenceOf } from "../api/problem";
import { duration, percent, short, verdictText } from "../format";
import { confusionOf } from "../model/confusion";
import { ConfusionTable } from "../parts/confusion";
import { Figures, Panel, Problem } from "../parts/bits";
import { navigate } from "../router";
import { JobList, JobPage } from "./jobs";

interface Score {
  false_alarm_events: number;
  fault_flights: number;
  healthy_h: number;
  isolated: { flights: number; median_s: number | null; p95_s: number | null; worst_s: number | null };
  right: number | null;
  right_95: [number, number] | null;
  windows: number;
  /** Truth, verdict, windows; only over all flights. */
  confusion_truth_verdict_windows?: [number, number, number][];
}
type Scores = Record<"sequential" | "t_test" | "network", Score>;
interface Result {
  flights: number;
  failed: number;
  flown_h: number;
  steps: number;
  detectors: Scores;
  axes: { axis: string; groups: { value: unknown; flights: number; failed: number; detectors: Scores }[] }[];
}
const DETECTORS = [["sequential", "sequential"], ["t_test", "T-test"], ["network", "network"]] as const;

export default function Campaigns(props: { id: string | undefined }) {
  return (
    <Show when={props.id} fallback={<JobList collection="campaigns" path="/campaigns" title="Campaigns" form={(reload) => <NewCampaign onSubmitted={reload} />} />} keyed>
      {(id) => (
        <JobPage<Result> collection="campaigns" path="/campaigns" id={id} counted="part" total={(facts) => facts["parts"] as number | undefined}>
          {(result) => <CampaignResult result={result} />}
        </JobPage>
      )}
    </Show>
  );
}

function NewCampaign(props: { onSubmitted: () => void }) {
  const [name, setName] = createSignal("");
  const [text, setText] = createSignal("");
  const [refusal, setRefusal] = createSignal<ApiError>();
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    setRefusal(undefined);
    try {
      const job = await ask<Schemas["JobView"]>("POST", "/api/v1/campaigns", text().trim() ? { text: text() } : { campaign: name().trim() });
      props.onSubmitted();
      navigate(`/campaigns/${job.id}`);
    } catch (error) {
      setRefusal(error instanceof ApiError ? error : new ApiError(0, sentenceOf(error)));
    }
  };
  return (
    <Panel title="New campaign">
      <form class="stack" onSubmit={(event) => void submit(event)}>
        <div class="fields">
          <label class="field">Name of the library
            <input type="text" value={name()} placeholder="quad-lag" onInput={(event) => setName(event.currentTarget.value)} />
          </label>
          <button type="submit" class="main" disabled={!name().trim() && !text().trim()}>Fly</button>
        </div>
        <details>
          <summary>or a document of one's own (TOML)</summary>
          <textarea rows="10" spellcheck={false} aria-label="campaign document" value={text()} onInput={(event) => setText(event.currentTarget.value)} />
        </details>
        <Problem sentence={refusal()?.sentence} complaints={refusal()?.complaints} />
      </form>
    </Panel>
  );
}

function CampaignResult(props: { result: Result }) {
  const it = () => props.result;
  const [detector, setDetector] = createSignal<keyof Scores>("sequential");
  const confusion = createMemo(() =>
    confusionOf((it().detectors[detector()].confusion_truth_verdict_windows ?? []).map(([truth, verdict, windows]) => [verdictText(truth), verdictText(verdict), windows] as const)),
  );
  return (
    <>
      <Panel title="Detectors over all flights">
        <div class="stack">
          <Figures items={[["flights", it().flights.toLocaleString("en")], ["failed", String(it().failed)], ["flown", `${short(it().flown_h)} h`], ["steps", it().steps.toLocaleString("en")]]} />
          <ScoreTable rows={[{ name: "all", scores: it().detectors }]} head="" />
        </div>
      </Panel>
      <Panel title="Confusion matrix" note="windows; row: true fault; column: verdict" actions={<Choice value={detector()} choose={setDetector} />}>
        <ConfusionTable confusion={confusion()} corner="truth / verdict" />
      </Panel>
      <For each={it().axes}>
        {(axis) => (
          <Panel title={`By ${axis.axis}`}>
            <ScoreTable head={axis.axis} rows={axis.groups.map((group) => ({ name: typeof group.value === "string" ? group.value : JSON.stringify(group.value), scores: group.detectors, flights: group.flights }))} />
          </Panel>
        )}
      </For>
      <p class="small muted">Detection delay: from the fault to the first window with the right verdict. [ ]: 95 % interval. Flown: {duration(3600 * it().flown_h)}.</p>
    </>
  );
}

function Choice(props: { value: keyof Scores; choose: (value: keyof Scores) => void }) {
  return (
    <span class="row" role="group" aria-label="detector">
      <For each={DETECTORS}>{([key, name]) => <button type="button" aria-pressed={props.value === key} onClick={() => props.choose(key)}>{name}</button>}</For>
    </span>
  );
}

function ScoreTable(props: { head: string; rows: readonly { name: string; scores: Scores; flights?: number }[] }) {
  return (
    <div class="scroll" tabindex="0" role="region" aria-label={`Scores by ${props.head || "detector"}`}>
      <table class="small">
        <thead>
          <tr>
            <th scope="col">{props.head}</th><th scope="col">detector</th><th class="r" scope="col">right windows</th><th class="r" scope="col">fault flights isolated</th>
            <th class="r" scope="col">delay, median s</th><th class="r" scope="col">95 %, s</th><th class="r" scope="col">worst, s</th><th class="r" scope="col">false alarms</th><th class="r" scope="col">per healthy hour</th>
          </tr>
        </thead>
        <tbody>
          <For each={props.rows}>
            {(row) => (
              <For each={DETECTORS}>
                {([key, name], place) => {
                  const score = () => row.scores[key];
                  return (
                    <Show when={score().windows > 0}>
                      <tr>
                        <td>{place() === 0 ? row.name : ""}{place() === 0 && row.flights ? ` (${row.flights} flights)` : ""}</td>
                        <td>{name}</td>
                        <td class="r">{percent(score().right)} {score().right_95 ? `[${percent(score().right_95?.[0])}, ${percent(score().right_95?.[1])}]` : ""}</td>
                        <td class="r">{score().isolated.flights} of {score().fault_flights}</td>
                        <td class="r">{short(score().isolated.median_s)}</td>
                        <td class="r">{short(score().isolated.p95_s)}</td>
                        <td class="r">{short(score().isolated.worst_s)}</td>
                        <td class="r">{score().false_alarm_events}</td>
                        <td class="r">{score().healthy_h > 0 ? short(score().false_alarm_events / score().healthy_h) : "–"}</td>
                      </tr>
                    </Show>
                  );
                }}
              </For>
            )}
          </For>
        </tbody>
      </table>
    </div>
  );
}
