/** All runs: table with filters, and a new run. */
import { For, Show, createEffect, createSignal, onCleanup } from "solid-js";
import { type Schemas, ask, get } from "../api/client";
import { createLoad } from "../api/load";
import { newsRefusal, onNews } from "../api/news";
import { sentenceOf } from "../api/problem";
import { duration, moment, verdictText } from "../format";
import { Panel, Problem, StatusTag } from "../parts/bits";
import type { FullGeometry } from "../replay/motion";
import { route, setQuery } from "../router";
import { NewRun } from "./new-run";

type Run = Schemas["Run"];
const PAGE = 50;
const STATES = ["queued", "running", "done", "failed", "canceled"] as const;
/** Verdicts to choose from: healthy, those without a rotor, the rotors of the largest vehicles; a pair by a link. */
const VERDICTS = [0, -1, -3, -2, ...Array.from({ length: 8 }, (_, k) => k + 1)];
/** A burst of events reloads the list once. */
const SETTLE_MS = 400;

export default function Runs() {
  const query = () => route().query;
  const filter = () => ({
    status: (query().get("status") ?? undefined) as Run["status"] | undefined,
    name: query().get("name") ?? undefined,
    parent: query().get("parent") ?? undefined,
    vehicle: query().get("vehicle") ?? undefined,
    verdict: numberOf(query().get("verdict")),
    from_ms: dayStart(query().get("from")),
    // Including the whole of the last day.
    to_ms: dayStart(query().get("to"), 1),
  });
  const isFiltered = () => Object.values(filter()).some((value) => value !== undefined);
  const verdicts = () => [...new Set([...VERDICTS, ...(filter().verdict === undefined ? [] : [filter().verdict as number])])];
  const [more, setMore] = createSignal<Run[]>([]);
  const [next, setNext] = createSignal<string | null>();
  const [problem, setProblem] = createSignal<string>();
  const key = () => JSON.stringify(filter());
  const library = createLoad(() => true, async (_, signal) => (await get("/api/v1/vehicles", { signal })).items);
  /** A vehicle has a name in the library (f550), and one in its document (DJI F550), which its runs have: both are understood. */
  const ofRuns = async (vehicle: string | undefined, signal?: AbortSignal): Promise<string | undefined> => {
    if (vehicle === undefined || !(await get("/api/v1/vehicles", { signal })).items.includes(vehicle)) return vehicle;
    return (await ask<FullGeometry>("GET", `/api/v1/vehicles/${encodeURIComponent(vehicle)}/geometry`, undefined, { signal })).name;
  };
  const page = createLoad(key, async (_, signal) => {
    const found = await get("/api/v1/runs", { query: { ...filter(), vehicle: await ofRuns(filter().vehicle, signal), limit: PAGE }, signal });
    setMore([]);
    setNext(found.next ?? null);
    return found;
  });
  const rows = () => [...(page.data()?.items ?? []), ...more()];
  const loadMore = async () => {
    try {
      const found = await get("/api/v1/runs", { query: { ...filter(), vehicle: await ofRuns(filter().vehicle), limit: 500, cursor: next() ?? undefined } });
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
          <label class="field">
            Vehicle
            <input type="search" list="vehicles" value={filter().vehicle ?? ""} placeholder="f550 or DJI F550" onChange={(event) => setQuery({ vehicle: event.currentTarget.value.trim() || undefined })} />
            <datalist id="vehicles"><For each={[...new Set([...(library.data() ?? []), ...rows().map((run) => run.vehicle)])]}>{(name) => <option value={name} />}</For></datalist>
          </label>
          <label class="field">
            Verdict at the end
            <select value={query().get("verdict") ?? ""} onChange={(event) => setQuery({ verdict: event.currentTarget.value || undefined })}>
              <option value="">any</option>
              <For each={verdicts()}>{(code) => <option value={code} selected={filter().verdict === code}>{verdictText(code)}</option>}</For>
            </select>
          </label>
          <label class="field">
            From day
            <input type="date" value={query().get("from") ?? ""} onChange={(event) => setQuery({ from: event.currentTarget.value || undefined })} />
          </label>
          <label class="field">
            To day
            <input type="date" value={query().get("to") ?? ""} onChange={(event) => setQuery({ to: event.currentTarget.value || undefined })} />
          </label>
          <Show when={isFiltered()}>
            <button type="button" onClick={() => setQuery({ status: undefined, name: undefined, parent: undefined, vehicle: undefined, verdict: undefined, from: undefined, to: undefined })}>Show all runs</button>
          </Show>
          <Show when={filter().parent}>
            <button type="button" onClick={() => setQuery({ parent: undefined })}>Only those made from {filter().parent?.slice(0, 8)} … : show all</button>
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
                <th scope="col">Verdict</th>
                <th scope="col">Submitted</th>
                <th class="r" scope="col">Took</th>
                <th scope="col">Run hash or reason</th>
                <th scope="col"><span class="sr">Actions</span></th>
              </tr>
            </thead>
            <tbody>
              <For each={rows()} fallback={<tr><td colspan="10" class="muted">{page.loading() ? "Loading …" : page.error() ? "" : isFiltered() ? "No run matches these filters." : "No run yet. Begin with “New run”."}</td></tr>}>
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
                    <td>{run.verdict === null || run.verdict === undefined ? "" : verdictText(run.verdict)}</td>
                    <td class="num">{moment(run.submitted_ms)}</td>
                    <td class="r">{took(run)}</td>
                    <td class="small break">{run.error ? run.error : <code>{run.run_hash?.slice(0, 16) ?? ""}</code>}</td>
                    <td>
                      <Show when={run.status === "running" || run.status === "queued"}>
                        <button type="button" disabled={run.cancel_requested} onClick={() => void act(run.id, "cancel")}>
                          {run.cancel_requested ? "Canceling …" : "Cancel"}
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

function numberOf(text: string | null): number | undefined {
  return text !== null && /^-?\d+$/.test(text) ? Number(text) : undefined;
}

/** Start of a day in the user's time zone, ms since 1970; `later` days after it. */
function dayStart(text: string | null, later = 0): number | undefined {
  const [year, month, day] = (text ?? "").split("-").map(Number);
  const at = year && month && day ? new Date(year, month - 1, day + later).getTime() : Number.NaN;
  return Number.isFinite(at) ? at : undefined;
}
