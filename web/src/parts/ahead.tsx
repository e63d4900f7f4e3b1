/** What a queued job waits for: the jobs that the server is working on, each with a button to cancel it. */
import { For, Show, createSignal, onCleanup } from "solid-js";
import { type Schemas, ask } from "../api/client";
import { sentenceOf } from "../api/problem";
import { duration } from "../format";

const COLLECTIONS = ["runs", "logs", "comparisons", "diagnoses", "improvements", "identifications", "next-flights", "classifiers", "campaigns", "blind-benches", "verifications"];
/** A free slot takes a job within this; only then is something in its way. */
const PATIENCE_MS = 2000;
const AGAIN_MS = 10_000;

type Running = { collection: string; job: Schemas["JobPage"]["items"][number] };

async function runningJobs(signal: AbortSignal): Promise<Running[]> {
  const pages = COLLECTIONS.map(async (collection) => {
    const page = await ask<Schemas["JobPage"]>("GET", `/api/v1/${collection}?status=running&limit=3`, undefined, { signal });
    return page.items.map((job) => ({ collection, job }));
  });
  return (await Promise.all(pages)).flat();
}

/** `run`, of `runs`. */
const kindOf = (collection: string) => ({ diagnoses: "diagnosis", "blind-benches": "blind bench", logs: "import", "next-flights": "next flight" })[collection] ?? collection.replace(/s$/, "");

export function Ahead() {
  const [running, setRunning] = createSignal<readonly Running[]>([]);
  const [problem, setProblem] = createSignal<string>();
  const abort = new AbortController();
  let timer: ReturnType<typeof setTimeout>;
  const look = async () => {
    try {
      setRunning(await runningJobs(abort.signal));
      setProblem(undefined);
    } catch (error) {
      if (!abort.signal.aborted) setProblem(sentenceOf(error));
    }
    if (!abort.signal.aborted) timer = setTimeout(() => void look(), AGAIN_MS);
  };
  timer = setTimeout(() => void look(), PATIENCE_MS);
  onCleanup(() => {
    abort.abort();
    clearTimeout(timer);
  });
  const cancel = async (one: Running) => {
    try {
      await ask("POST", `/api/v1/${one.collection}/${one.job.id}/cancel`);
      setRunning((now) => now.filter((other) => other.job.id !== one.job.id));
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  const since = (one: Running) => (one.job.started_ms ? `, for ${duration((Date.now() - one.job.started_ms) / 1000)}` : "");
  return (
    <>
      <Show when={running().length > 0}>
        <ul class="small" aria-label="What the server is working on">
          <For each={running()}>
            {(one) => (
              <li>
                The server is working on the {kindOf(one.collection)} {one.job.name}{since(one)}.{" "}
                <button type="button" class="small" onClick={() => void cancel(one)}>Cancel it</button>
              </li>
            )}
          </For>
        </ul>
      </Show>
      <Show when={problem()}><p class="small muted">What the server is working on cannot be told: {problem()}</p></Show>
    </>
  );
}
