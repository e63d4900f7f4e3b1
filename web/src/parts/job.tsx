/** A running job: its progress, and a button to stop it. */
import { Show } from "solid-js";
import type { Followed } from "../api/job";
import { percent } from "../format";
import { Ahead } from "./ahead";
import { Problem, Progress } from "./bits";

/** `share`: fraction done, for a job that does not report it itself. */
export function JobProgress(props: { job: Followed<unknown>; what: string; share?: number | undefined; retry?: (() => void) | undefined }) {
  const share = () => props.job.progress().share ?? props.share;
  return (
    <>
      <Show when={props.job.running()}>
        <div class="row" role="status">
          <Progress share={share()} what={props.what} />
          <span>{props.what}{props.job.job()?.status === "queued" ? ": waiting in the queue" : ""}</span>
          <Show when={share() !== undefined}><span class="num">{percent(share(), 0)}</span></Show>
          <span class="muted">{props.job.progress().text}</span>
          <button type="button" disabled={props.job.job()?.cancel_requested} onClick={() => void props.job.cancel()}>
            {props.job.job()?.cancel_requested ? "Canceling …" : "Cancel"}
          </button>
        </div>
        <Show when={props.job.job()?.status === "queued"}><Ahead /></Show>
      </Show>
      <Problem sentence={props.job.error()} {...(props.retry ? { retry: props.retry } : {})} />
    </>
  );
}
