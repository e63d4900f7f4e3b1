/** A job of any collection, followed from its id. */
import { type Accessor, createEffect, createSignal, on, onCleanup } from "solid-js";
import type { Schemas } from "./client";
import { ask } from "./client";
import { hasEnded, watchJob } from "./news";
import { ApiError, sentenceOf } from "./problem";

export type JobView = Schemas["JobView"];

export interface Followed<R> {
  job: Accessor<JobView | undefined>;
  /** Result, once it is done. */
  result: Accessor<R | undefined>;
  /** Fraction done and current activity, where the job reports them. */
  progress: Accessor<{ share: number | undefined; text: string }>;
  running: Accessor<boolean>;
  /** Why it failed, or why it cannot be followed: one sentence. */
  error: Accessor<string | undefined>;
  cancel: () => Promise<void>;
}

export function createJob<R>(collection: string, id: Accessor<string | undefined>): Followed<R> {
  const [known, setJob] = createSignal<JobView>();
  const [progress, setProgress] = createSignal<{ share: number | undefined; text: string }>({ share: undefined, text: "" });
  const [problem, setProblem] = createSignal<string>();
  createEffect(
    on(id, (wanted) => {
      setJob(undefined);
      setProblem(undefined);
      setProgress({ share: undefined, text: "" });
      if (wanted === undefined) return;
      onCleanup(
        watchJob<JobView & { result?: unknown }>(
          collection,
          wanted,
          (next) => setJob(next),
          (event, data) => {
            if (event !== "progress") return;
            const share = data["share"];
            setProgress({ share: typeof share === "number" ? share : undefined, text: typeof data["text"] === "string" ? data["text"] : "" });
          },
          (error) => setProblem(sentenceOf(error)),
        ),
      );
    }),
  );
  // An address that changes is seen before its effects have run: the job before is not the one asked for.
  const job = () => (known()?.id === id() ? known() : undefined);
  return {
    job,
    result: () => (job()?.status === "done" ? ((job()?.result ?? undefined) as R | undefined) : undefined),
    progress,
    running: () => id() !== undefined && problem() === undefined && !hasEnded(job()?.status),
    error: () => {
      if (problem() !== undefined) return problem();
      // The program's terminal output is of no use on a page.
      if (job()?.status === "failed") return job()?.error?.replace(/^rotortwin: /, "") ?? "It failed, and the server does not say why.";
      return job()?.status === "canceled" ? "It was canceled." : undefined;
    },
    cancel: async () => {
      try {
        const asked = await ask<JobView>("POST", `/api/v1/${collection}/${id()}/cancel`);
        // The event of its end may have overtaken this answer.
        setJob((now) => (now?.id === asked.id && hasEnded(now.status) ? now : asked));
      } catch (error) {
        // 409: it has ended meanwhile; its event says how.
        if (!(error instanceof ApiError) || error.status !== 409) setProblem(sentenceOf(error));
      }
    },
  };
}
