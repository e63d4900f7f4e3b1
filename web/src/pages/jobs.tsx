/** Lists of campaigns and blind benches with a form to start one; one of them with its progress and result. */
import { For, type JSX, Show, createSignal, onCleanup } from "solid-js";
import { type Schemas, ask } from "../api/client";
import { createJob } from "../api/job";
import { createLoad } from "../api/load";
import { newsRefusal, onNews } from "../api/news";
import { duration, moment } from "../format";
import { Panel, Problem, StatusTag } from "../parts/bits";
import { JobProgress } from "../parts/job";

const SETTLE_MS = 500;

export function JobList(props: { collection: string; path: string; title: string; form: (reload: () => void) => JSX.Element }) {
  const page = createLoad(() => true, (_, signal) => ask<Schemas["JobPage"]>("GET", `/api/v1/${props.collection}?limit=100`, undefined, { signal }));
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
      <Panel title="All" note="latest first" actions={<button type="button" onClick={page.reload}>Reload</button>}>
        <Problem sentence={page.error()} retry={page.reload} />
        <Show when={newsRefusal()}><p class="small muted">{newsRefusal()} Use "Reload".</p></Show>
        <div class="scroll" tabindex="0" role="region" aria-label={`Table of ${props.title}`}>
          <table>
            <thead><tr><th scope="col">Name</th><th scope="col">State</th><th scope="col">Asked for</th><th scope="col">Submitted</th><th class="r" scope="col">Took</th><th scope="col">Reason</th></tr></thead>
            <tbody>
              <For each={page.data()?.items ?? []} fallback={<tr><td colspan="6" class="muted">{page.loading() ? "Loading …" : "none yet"}</td></tr>}>
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
      </Panel>
    </>
  );
}

/** `flights 192, seed 20004`. */
export function factsText(facts: unknown): string {
  return Object.entries((facts ?? {}) as Record<string, unknown>)
    .filter(([, value]) => value !== null && (typeof value !== "object" || Array.isArray(value)))
    .map(([name, value]) => `${name.replaceAll("_", " ")} ${Array.isArray(value) ? value.join(" ") : String(value)}`)
    .join(", ");
}

/** One job; `counted` is the kind of event of which there will be `total`. */
export function JobPage<R>(props: { collection: string; path: string; id: string; counted: string; total: (facts: Record<string, unknown>) => number | undefined; children: (result: R) => JSX.Element }) {
  const job = createJob<R>(props.collection, () => props.id);
  const [seen, setSeen] = createSignal(0);
  const news = onNews((one) => one.job === props.id && one.event === props.counted && setSeen((count) => count + 1));
  onCleanup(news.stop);
  const total = () => props.total((job.job()?.facts ?? {}) as Record<string, unknown>);
  return (
    <>
      <div class="row">
        <h1>{job.job()?.name ?? "…"}</h1>
        <StatusTag status={job.job()?.status ?? "loading"} />
        <span class="muted small">{factsText(job.job()?.facts)}</span>
        <span class="grow" />
        <a class="button" href={props.path}>All</a>
        <Show when={job.job()?.status === "done"}>
          <a class="button" href={`/api/v1/${props.collection}/${props.id}/artifacts/report.html`} target="_blank" rel="noopener">Report</a>
        </Show>
      </div>
      {/* The whole is put together, and counts as running, once its parts have ended. */}
      <JobProgress job={job} what="Working" waits="its parts are done one after the other, or wait in the queue" />
      <Show when={job.running() && seen() > 0}>
        <p class="muted">{seen()}{total() ? ` of ${total()}` : ""} {props.counted}s ended since this page was opened.</p>
      </Show>
      <Show when={job.result()} keyed>{(result) => props.children(result)}</Show>
    </>
  );
}
