/** Lists of campaigns and blind benches with a form to start one; one of them with its progress and result. */
import { For, type JSX, Show, createSignal, onCleanup } from "solid-js";
import { type Schemas, ask, remove } from "../api/client";
import { createJob } from "../api/job";
import { createLoad } from "../api/load";
import { hasEnded, newsRefusal, onNews } from "../api/news";
import { sentenceOf } from "../api/problem";
import { count, duration, moment } from "../format";
import { Panel, Problem, StatusTag } from "../parts/bits";
import { JobProgress } from "../parts/job";
import { navigate } from "../router";

const SETTLE_MS = 500;
const PAGE = 100;

export function JobList(props: { collection: string; path: string; title: string; form: (reload: () => void) => JSX.Element }) {
  const pageAt = (query: string, signal?: AbortSignal) => ask<Schemas["JobPage"]>("GET", `/api/v1/${props.collection}?limit=${PAGE}${query}`, undefined, signal ? { signal } : {});
  const [more, setMore] = createSignal<Schemas["JobPage"]["items"]>([]);
  const [next, setNext] = createSignal<string | null>();
  const [problem, setProblem] = createSignal<string>();
  const page = createLoad(() => true, async (_, signal) => {
    const found = await pageAt("", signal);
    setMore([]);
    setNext(found.next ?? null);
    return found;
  });
  const rows = () => [...(page.data()?.items ?? []), ...more()];
  const loadMore = async (cursor: string) => {
    setProblem(undefined);
    try {
      const found = await pageAt(`&cursor=${encodeURIComponent(cursor)}`);
      setMore((before) => [...before, ...found.items]);
      setNext(found.next ?? null);
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  let timer: ReturnType<typeof setTimeout> | undefined;
  const news = onNews((one) => {
    if (one.collection !== props.collection || !["queued", "started", "ended", "requeued"].includes(one.event)) return;
    clearTimeout(timer);
    timer = setTimeout(page.reload, SETTLE_MS);
  });
  onCleanup(() => {
    news.stop();
    clearTimeout(timer);
  });
  return (
    <>
      <h1>{props.title}</h1>
      {props.form(page.reload)}
      <Panel title={`All ${props.title.toLowerCase()}`} note="latest first" actions={<button type="button" onClick={page.reload}>Reload</button>}>
        <Problem sentence={problem() ?? page.error()} retry={() => { setProblem(undefined); page.reload(); }} />
        <Show when={newsRefusal()}><p class="small muted">{newsRefusal()} Use "Reload".</p></Show>
        <div class="scroll" tabindex="0" role="region" aria-label={`Table of ${props.title}`}>
          <table>
            <thead><tr><th scope="col">Name</th><th scope="col">State</th><th scope="col">Contents</th><th scope="col">Submitted</th><th class="r" scope="col">Took</th><th scope="col">Reason</th></tr></thead>
            <tbody>
              <For each={rows()} fallback={<tr><td colspan="6" class="muted">{page.loading() ? "Loading …" : page.error() ? "" : "None yet: start one above."}</td></tr>}>
                {(job) => (
                  <tr>
                    <td><a href={`${props.path}/${job.id}`}>{job.name}</a><div class="mono small muted">{job.id.slice(0, 12)}</div></td>
                    <td><StatusTag status={job.status} /></td>
                    <td class="small">{factsText(job.facts)}</td>
                    <td class="num">{moment(job.submitted_ms)}</td>
                    <td class="r">{job.finished_ms && job.started_ms ? duration((job.finished_ms - job.started_ms) / 1000) : "–"}</td>
                    <td class="small break">{job.error ?? ""}</td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
        <div class="row small muted">
          <span>{rows().length} shown</span>
          <Show when={next()}>{(cursor) => <button type="button" onClick={() => void loadMore(cursor())}>{PAGE} more</button>}</Show>
        </div>
      </Panel>
    </>
  );
}

type Facts = Partial<Schemas["CampaignFacts"] & Schemas["BlindBenchFacts"]>;

/** `192 flights, seed 20004, 6 parts`. */
export function factsText(facts: unknown): string {
  const it = (facts ?? {}) as Facts;
  const words = [
    it.flights !== undefined && count(it.flights, "flight"),
    it.cases !== undefined && `${count(it.cases, "case")}${it.presets ? ` of ${it.presets.join(", ")}` : ""}`,
    it.vehicles && it.vehicles.join(", "),
    it.duration_s !== undefined && `${it.duration_s} s each`,
    it.seed !== undefined && `seed ${it.seed}`,
    it.classifier && `classifier ${it.classifier.slice(0, 12)}`,
    it.parts && count(it.parts, "part"),
  ];
  return words.filter(Boolean).join(", ");
}

/** One job in parts; `counted` is a kind of event within a part, of which there will be `total`. */
export function JobPage<R>(props: { collection: string; path: string; title: string; id: string; counted?: string; total?: (facts: Record<string, unknown>) => number | undefined; children: (result: R) => JSX.Element }) {
  const job = createJob<R>(props.collection, () => props.id);
  const [seen, setSeen] = createSignal(0);
  const news = onNews((one) => one.job === props.id && one.event === props.counted && setSeen((count) => count + 1));
  onCleanup(news.stop);
  const total = () => props.total?.((job.job()?.facts ?? {}) as Record<string, unknown>);
  const [problem, setProblem] = createSignal<string>();
  const ended = () => hasEnded(job.job()?.status);
  const parts = () => (job.job()?.facts as Facts | undefined)?.parts ?? 0;
  const partsDone = () => parts() - (job.job()?.waits_for ?? 0);
  const discard = async () => {
    setProblem(undefined);
    try {
      await remove(`/api/v1/${props.collection}/${props.id}`);
      navigate(props.path);
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  return (
    <>
      <div class="row">
        <h1>{job.job()?.name ?? props.title.replace(/e?s$/, "")}</h1>
        <Show when={job.job()?.status ?? (job.error() ? undefined : "loading")}>{(status) => <StatusTag status={status()} />}</Show>
        <span class="muted small">{factsText(job.job()?.facts)}</span>
        <span class="grow" />
        <a class="button" href={props.path}>All {props.title.toLowerCase()}</a>
        <Show when={job.job()?.status === "done"}>
          <a class="button" href={`/api/v1/${props.collection}/${props.id}/artifacts/report.html`} target="_blank" rel="noopener">Report</a>
        </Show>
        <Show when={ended()}>
          <button type="button" class="danger" onClick={() => confirm(`Delete ${job.job()?.name ?? ""} and its files?`) && void discard()}>Delete</button>
        </Show>
      </div>
      <Problem sentence={problem()} />
      <JobProgress job={job} what="Working" share={parts() > 0 && job.job()?.status === "running" ? partsDone() / parts() : undefined} />
      <Show when={job.running() && parts() > 0}>
        <p class="muted">
          {partsDone()} of {count(parts(), "part")} done{partsDone() === parts() ? ", which are now merged" : ""}.
          <Show when={props.counted && seen() > 0}> {seen()}{total() ? ` of ${total()}` : ""} {props.counted}s ended since this page was opened.</Show>
        </p>
      </Show>
      <Show when={job.result()} keyed>{(result) => props.children(result)}</Show>
    </>
  );
}
