/** Blind benches: hidden effects, diagnosed and scored. */
import { For, Show, createSignal } from "solid-js";
import { type Schemas, ask } from "../api/client";
import { ApiError, sentenceOf } from "../api/problem";
import { jsonWithSeed } from "../exact";
import { Panel, Problem } from "../parts/bits";
import { navigate, route, setQuery } from "../router";
import { type BlindResult, BlindView } from "../shown/blind";
import { BlindCases, type Cell } from "./blind-cases";
import { JobList, JobPage } from "./jobs";
import { createTyped } from "../typed";

/** Kinds of cases, and their hidden effects (docs/blind-bench.md). */
const PRESETS = [
  ["singles", "one effect of the catalogue at about its ordinary size"],
  ["pairs", "two effects that no group of confusable ones holds together"],
  ["clutter", "one effect, and every other parameter off by about 2 %"],
  ["helix", "one effect, on the paper's helix, where much cannot be tested"],
  ["null", "nothing, in motion: any name is a false one"],
  ["null-hover", "nothing, in hover"],
  ["null-still", "nothing, in a hover that is hardly disturbed"],
  ["small", "one effect at 0.3 of its size"],
  ["outside", "something that the catalogue lacks"],
  ["onset", "a blade that loses 5 % in mid-flight"],
  ["mixed", "singles, nothing, pairs and outside in turn"],
] as const;

export default function Blind(props: { id: string | undefined }) {
  return (
    <Show when={props.id} fallback={<JobList collection="blind-benches" path="/blind" title="Blind benches" form={(reload) => <NewBench onSubmitted={reload} />} />} keyed>
      {(id) => (
        <JobPage<BlindResult> collection="blind-benches" path="/blind" title="Blind benches" id={id} counted="case" total={(facts) => facts["cases"] as number | undefined}>
          {(result) => <BlindView result={result} cell={cell()} choose={choose} cases={<BlindCases id={id} cell={cell()} chosen={chosen()} />} />}
        </JobPage>
      )}
    </Show>
  );
}

/** What is looked at stands in the address. */
function cell(): Cell | undefined {
  const [hidden, named] = [route().query.get("hidden"), route().query.get("named")];
  return hidden !== null && named !== null ? { hidden, named } : undefined;
}
function chosen(): number | undefined {
  const number = route().query.get("case");
  return number !== null && /^\d+$/.test(number) ? Number(number) : undefined;
}
const choose = (cell: Cell | undefined) => setQuery({ hidden: cell?.hidden, named: cell?.named, case: undefined });

function NewBench(props: { onSubmitted: () => void }) {
  const [presets, setPresets] = createSignal<readonly string[]>(["singles"]);
  const [n, setN] = createTyped("bench.n", "6");
  const [seed, setSeed] = createTyped("bench.seed", "7");
  const [refusal, setRefusal] = createSignal<ApiError>();
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    setRefusal(undefined);
    try {
      const job = await ask<Schemas["JobView"]>("POST", "/api/v1/blind-benches", jsonWithSeed({ presets: presets(), n: Number(n()), seed: seed() }));
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
            {([one, what]) => (
              <label class="check" title={what}>
                <input type="checkbox" checked={presets().includes(one)} onChange={(event) => setPresets((before) => (event.currentTarget.checked ? [...before, one] : before.filter((other) => other !== one)))} />
                {one}<span class="sr">: {what}</span>
              </label>
            )}
          </For>
        </fieldset>
        <ul class="small muted">
          <For each={PRESETS.filter(([one]) => presets().includes(one))}>{([one, what]) => <li>{one}: {what}</li>}</For>
        </ul>
        <div class="fields">
          <label class="field">Cases of each preset<input type="number" min="1" max="10000" value={n()} onInput={(event) => setN(event.currentTarget.value)} /></label>
          <label class="field">Seed<input type="number" min="0" value={seed()} onInput={(event) => setSeed(event.currentTarget.value)} /></label>
          <button type="submit" class="main" disabled={presets().length === 0 || !(Number(n()) >= 1) || !/^\d+$/.test(seed())}>Begin</button>
        </div>
        <Problem sentence={refusal()?.sentence} complaints={refusal()?.complaints} />
      </form>
    </Panel>
  );
}
