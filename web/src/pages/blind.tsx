/** Blind benches: hidden effects, diagnosed and scored. */
import { For, Show, createMemo, createSignal } from "solid-js";
import { type Schemas, ask } from "../api/client";
import { ApiError, sentenceOf } from "../api/problem";
import { percent, short } from "../format";
import { confusionOf } from "../model/confusion";
import { Panel, Problem } from "../parts/bits";
import { ConfusionTable } from "../parts/confusion";
import { navigate } from "../router";
import { JobList, JobPage } from "./jobs";

const PRESETS = ["singles", "pairs", "clutter", "helix", "null", "null-hover", "null-still", "small", "outside", "onset", "mixed"] as const;
interface Share {
  count: number;
  of: number;
  share: number;
  low: number;
  high: number;
}
interface Group {
  name: string;
  cases: number;
  top1: Share;
  exact: Share;
  right_or_not_testable: Share;
  false_alarms: Share;
  confidently_wrong: Share;
  coverage: Share;
  seconds: [number, number];
}
interface Result {
  confusion: [string, string, number][];
  groups: Group[];
}

export default function Blind(props: { id: string | undefined }) {
  return (
    <Show when={props.id} fallback={<JobList collection="blind-benches" path="/blind" title="Blind benches" form={(reload) => <NewBench onSubmitted={reload} />} />} keyed>
      {(id) => (
        <JobPage<Result> collection="blind-benches" path="/blind" id={id} counted="case" total={(facts) => facts["cases"] as number | undefined}>
          {(result) => <Score result={result} />}
        </JobPage>
      )}
    </Show>
  );
}

function NewBench(props: { onSubmitted: () => void }) {
  const [presets, setPresets] = createSignal<readonly string[]>(["singles"]);
  const [n, setN] = createSignal("6");
  const [seed, setSeed] = createSignal("7");
  const [refusal, setRefusal] = createSignal<ApiError>();
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    setRefusal(undefined);
    try {
      const job = await ask<Schemas["JobView"]>("POST", "/api/v1/blind-benches", { presets: presets(), n: Number(n()), seed: Number(seed()) });
      props.onSubmitted();
      navigate(`/blind/${job.id}`);
    } catch (error) {
      setRefusal(error instanceof ApiError ? error : new ApiError(0, sentenceOf(error)));
    }
  };
  return (
    <Panel title="New bench" note="the independent simulator hides effects, the diagnosis looks for them, the truth is compared at the end">
      <form class="stack" onSubmit={(event) => void submit(event)}>
        <fieldset class="row">
          <legend class="small muted">Presets</legend>
          <For each={PRESETS}>
            {(one) => (
              <label class="check">
                <input type="checkbox" checked={presets().includes(one)} onChange={(event) => setPresets((before) => (event.currentTarget.checked ? [...before, one] : before.filter((other) => other !== one)))} />
                {one}
              </label>
            )}
          </For>
        </fieldset>
        <div class="fields">
          <label class="field">Cases of each preset<input type="number" min="1" max="10000" value={n()} onInput={(event) => setN(event.currentTarget.value)} /></label>
          <label class="field">Seed<input type="number" min="0" value={seed()} onInput={(event) => setSeed(event.currentTarget.value)} /></label>
          <button type="submit" class="main" disabled={presets().length === 0 || !(Number(n()) >= 1)}>Begin</button>
        </div>
        <Problem sentence={refusal()?.sentence} complaints={refusal()?.complaints} />
      </form>
    </Panel>
  );
}

const shareText = (share: Share) => (share.of === 0 ? "–" : `${share.count} of ${share.of}: ${percent(share.share)} [${percent(share.low, 0)}, ${percent(share.high, 0)}]`);

function Score(props: { result: Result }) {
  const confusion = createMemo(() => confusionOf(props.result.confusion));
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
      <Panel title="Confusion matrix" note="row: what was hidden; column: what was named; the diagonal is right">
        <ConfusionTable confusion={confusion()} corner="hidden / named" />
      </Panel>
    </>
  );
}
