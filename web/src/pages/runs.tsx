/** All runs: table with filters, and a new run. */
import { For, Show, createEffect, createSignal, onCleanup } from "solid-js";
import { type Schemas, ask, get } from "../api/client";
import { createLoad } from "../api/load";
import { newsRefusal, onNews } from "../api/news";
import { sentenceOf } from "../api/problem";
import { duration, moment } from "../format";
import { Panel, Problem, StatusTag } from "../parts/bits";
import { route, setQuery } from "../router";
import { NewRun } from "./new-run";

type Run = Schemas["Run"];
const PAGE = 50;
const STATES = ["queued", "running", "done", "failed", "canceled"] as const;
/** News in quick succession reload the list once. */
const SETTLE_MS = 400;

export default function Runs() {
  const query = () => route().query;
  const filter = () => ({
    status: (query().get("status") ?? undefined) as Run["status"] | undefined,
    name: query().get("name") ?? undefined,
    parent: query().get("parent") ?? undefined,
  });
  const [more, setMore] = createSignal<Run[]>([]);
  const [next, setNext] = createSignal<string | null>();
  const [problem, setProblem] = createSignal<string>();
  const key = () => JSON.stringify(filter());
  const page = createLoad(key, async (_, signal) => {
    const found = await get("/api/v1/runs", { query: { ...filter(), limit: PAGE }, signal });
    setMore([]);
    setNext(found.next ?? null);
    return found;
  });
  const rows = () => [...(page.data()?.items ?? []), ...more()];
  const loadMore = async () => {
    try {
      const found = await get("/api/v1/runs", { query: { ...filter(), limit: 500, cursor: next() ?? undefined } });
      setMore((before) => [...before, ...found.items]);
      setNext(found.next ?? null);
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  let timer: ReturnType<typeof setTimeout> | undefined;
  const news = onNews((one) => {
    if (one.collection !== "runs" || one.event === "progress" || one.event === "change") return;
    clearTimeout(timer);
    timer = setTimeout(page.reload, SETTLE_MS);
  });
  onCleanup(() => {
    news.stop();
    clearTimeout(timer);
  });
  const [chosen, setChosen] = createSignal<readonly string[]>([]);
  const choose = (id: string, on: boolean) => setChosen((before) => (on ? [...before, id] : before.filter((one) => one !== id)));
  createEffect(() => {
    const there = new Set(rows().map((run) => run.id));
    setChosen((before) => (before.every((id) => there.has(id)) ? before : before.filter((id) => there.has(id))));
  });
  const act = async (id: string, what: "cancel" | "verify") => {
    setProblem(undefined);
    try {
      await ask("POST", `/api/v1/runs/${id}/${what}`);
      page.reload();
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };

  return (
    <>
      <div class="row">
        <h1 class="grow">Runs</h1>
        <button type="button" class="main" aria-expanded={query().has("new")} onClick={() => setQuery({ new: query().has("new") ? undefined : "1" })}>
          {query().has("new") ? "Close the form" : "New run"}
        </button>
      </div>
      <Show when={query().has("new")}>
        <NewRun onSubmitted={page.reload} />
      </Show>
      <Panel
        title="All runs"
        note="latest first"
        actions={
          <>
            <Show when={chosen().length >= 2}>
              <a class="button" href={`/runs/${chosen()[0]}?with=${chosen().slice(1).join(",")}`}>Compare {chosen().length} runs</a>
            </Show>
            <button type="button" onClick={page.reload}>Reload</button>
          </>
        }
      >
        <div class="fields">
          <label class="field">
            State
            <select value={filter().status ?? ""} onChange={(event) => setQuery({ status: event.currentTarget.value || undefined })}>
              <option value="">any</option>
              <For each={STATES}>{(state) => <option value={state}>{state}</option>}</For>
            </select>
          </label>
          <label class="field">
            Scenario
            <input type="search" value={filter().name ?? ""} placeholder="exact name" onChange={(event) => setQuery({ name: event.currentTarget.value.trim() || undefined })} />
          </label>
          <Show when={filter().parent}>
            <button type="button" onClick={() => setQuery({ parent: undefined })}>Only forks of {filter().parent?.slice(0, 8)} … : show all</button>
          </Show>
        </div>
        <Problem sentence={problem() ?? page.error()} retry={page.reload} />
        <Show when={newsRefusal()}>
          <p class="small muted">{newsRefusal()} This table does not follow by itself: use "Reload".</p>
        </Show>
        <div class="scroll" tabindex="0" role="region" aria-label="Table of runs">
          <table>
            <thead>
              <tr>
                <th scope="col"><span class="sr">Choose</span></th>
                <th scope="col">Run</th>
                <th scope="col">Vehicle</th>
                <th class="r" scope="col">Seed</th>
                <th scope="col">State</th>
                <th scope="col">Submitted</th>
                <th class="r" scope="col">Took</th>
                <th scope="col">Run hash or reason</th>
                <th scope="col"><span class="sr">Actions</span></th>
              </tr>
            </thead>
            <tbody>
              <For each={rows()} fallback={<tr><td colspan="9" class="muted">{page.loading() ? "Loading …" : "No run of this kind. Begin with “New run”."}</td></tr>}>
                {(run) => (
                  <tr>
                    <td>
                      <Show when={run.status === "done"}>
                        <input
                          type="checkbox"
                          aria-label={`Choose ${run.name} ${run.id} for a comparison`}
                          checked={chosen().includes(run.id)}
                          onChange={(event) => choose(run.id, event.currentTarget.checked)}
                        />
                      </Show>
                    </td>
                    <td><a href={`/runs/${run.id}`}>{run.name}</a><div class="mono small muted">{run.id.slice(0, 12)}</div></td>
                    <td>{run.vehicle}</td>
                    <td class="r">{run.seed}</td>
                    <td><StatusTag status={run.status} /></td>
                    <td class="num">{moment(run.submitted_ms)}</td>
                    <td class="r">{took(run)}</td>
                    <td class="small break">{run.error ? run.error : <code>{run.run_hash?.slice(0, 16) ?? ""}</code>}</td>
                    <td>
                      <Show when={run.status === "running" || run.status === "queued"}>
                        <button type="button" disabled={run.cancel_requested} onClick={() => void act(run.id, "cancel")}>
                          {run.cancel_requested ? "canceling" : "Cancel"}
                        </button>
                      </Show>
                    </td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
        <div class="row small muted">
          <span>{rows().length} shown</span>
          <Show when={next()}><button type="button" onClick={() => void loadMore()}>500 more</button></Show>
        </div>
      </Panel>
    </>
  );
}

function took(run: Run): string {
  if (!run.started_ms) return "–";
  return run.finished_ms ? duration((run.finished_ms - run.started_ms) / 1000) : "";
}
