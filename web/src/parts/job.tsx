/** A running job: its progress, and a button to stop it. */
import { Show } from "solid-js";
import type { Followed } from "../api/job";
import { percent } from "../format";
import { Problem, Progress } from "./bits";

export function JobProgress(props: { job: Followed<unknown>; what: string; waits?: string; retry?: (() => void) | undefined }) {
  return (
    <>
      <Show when={props.job.running()}>
        <div class="row" role="status">
          <Progress share={props.job.progress().share} what={props.what} />
          <span>{props.what}{props.job.job()?.status === "queued" ? `: ${props.waits ?? "waiting in the queue"}` : ""}</span>
          <Show when={props.job.progress().share !== undefined}><span class="num">{percent(props.job.progress().share, 0)}</span></Show>
          <span class="muted">{props.job.progress().text}</span>
          <button type="button" disabled={props.job.job()?.cancel_requested} onClick={() => void props.job.cancel()}>
            {props.job.job()?.cancel_requested ? "Canceling …" : "Cancel"}
          </button>
        </div>
      </Show>
      <Problem sentence={props.job.error()} {...(props.retry ? { retry: props.retry } : {})} />
    </>
  );
}
