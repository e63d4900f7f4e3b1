/**
 * Events of all the caller's jobs: one event stream for all tabs of a browser.
 *
 * Browsers open six connections per host (HTTP/1.1), and an event stream occupies one. So one tab reads the stream and forwards it to
 * the others; when it is closed, another one resumes after the last event it has seen. In a browser without locks (a page without
 * HTTPS on another host), each tab reads its own stream.
 */
import { createSignal } from "solid-js";
import { ask } from "./client";
import { onBack } from "./connection";
import { follow } from "./events";
import { ApiError, sentenceOf } from "./problem";

export interface News {
  job: string;
  collection: string;
  /** Kind: `queued`, `started`, `progress`, `ended`, …. */
  event: string;
  data: Record<string, unknown>;
}

type Told = { cursor: string; news?: News };

const CHANNEL = "rotortwin.news";
const [refusal, setRefusal] = createSignal<string>();
const listeners = new Set<(news: News) => void>();
let cursor = "";
let begun: Promise<void> | undefined;

/** Why there are no events, if the server refuses the stream. */
export { refusal as newsRefusal };

/** Calls `listener` for each event from now on; returns a function that unsubscribes. Resolves once no later event can be missed. */
export function onNews(listener: (news: News) => void): { open: Promise<void>; stop: () => void } {
  listeners.add(listener);
  begun ??= begin();
  return { open: begun, stop: () => listeners.delete(listener) };
}

function begin(): Promise<void> {
  return new Promise((opened) => {
    const channel = new BroadcastChannel(CHANNEL);
    const take = (told: Told) => {
      cursor = told.cursor;
      opened();
      if (told.news) for (const listener of [...listeners]) listener(told.news);
    };
    channel.onmessage = (message) => {
      if (message.data === "anybody") return;
      take(message.data as Told);
    };
    const read = async () => {
      // A tab opened later learns from the reader that the stream is open.
      channel.onmessage = (message) => {
        if (message.data === "anybody" && cursor) channel.postMessage({ cursor } satisfies Told);
      };
      const tell = (told: Told) => {
        channel.postMessage(told);
        take(told);
      };
      const url = cursor ? `/api/v1/events?after=${encodeURIComponent(cursor)}` : "/api/v1/events";
      try {
        await follow(url, (event) => {
          if (event.event === "open") tell({ cursor: event.id });
          else {
            const { job, collection, data } = JSON.parse(event.data) as { job: string; collection: string; data: Record<string, unknown> };
            tell({ cursor: event.id, news: { job, collection, event: event.event, data } });
          }
        }, new AbortController().signal, cursor);
      } catch (error) {
        setRefusal(error instanceof ApiError && error.status === 404 ? "This server has no stream of events for all jobs." : sentenceOf(error));
        opened();
      }
    };
    if (navigator.locks) {
      void navigator.locks.request(CHANNEL, read);
      channel.postMessage("anybody");
    } else void read();
  });
}

/** A job as every collection shows it, runs included. */
export interface AnyJob {
  id: string;
  name: string;
  status: "queued" | "running" | "done" | "failed" | "canceled";
  error?: string | null;
  result?: unknown;
}

/** Whether a job's state is final. */
export const hasEnded = (status: AnyJob["status"] | undefined) => status === "done" || status === "failed" || status === "canceled";

/**
 * Follows a job until it has ended: `onJob` with its first and each later state, `onEvent` with its events.
 *
 * Without the stream for all jobs, the job's own one is read.
 */
export function watchJob<J extends AnyJob>(
  collection: string,
  id: string,
  onJob: (job: J) => void,
  onEvent: (event: string, data: Record<string, unknown>) => void,
  onError: (error: unknown) => void,
): () => void {
  const url = `/api/v1/${collection}/${id}`;
  const control = new AbortController();
  let stop: (() => void) | undefined;
  let ended = false;
  const look = async () => {
    const job = await ask<J>("GET", url, undefined, { signal: control.signal });
    if (control.signal.aborted) return true;
    // Answers of two requests may arrive out of order: an ended job does not run again.
    if (!ended) onJob(job);
    ended ||= hasEnded(job.status);
    return ended;
  };
  const told = (event: string, data: Record<string, unknown>) => {
    onEvent(event, data);
    if (event === "started" || event === "requeued" || event === "part" || event === "ended") {
      look().then((ended) => ended && stop?.(), onError);
    }
  };
  const start = async () => {
    if (await look()) return;
    // Whatever the stream sends after an outage, the job's state is requested once more.
    const ignore = onBack(() => void look().then((ended) => ended && stop?.(), onError));
    control.signal.addEventListener("abort", ignore);
    const news = onNews((one) => one.job === id && told(one.event, one.data));
    stop = news.stop;
    control.signal.addEventListener("abort", news.stop);
    await news.open;
    if (refusal() !== undefined) {
      news.stop();
      await follow(`${url}/events`, (event) => {
        told(event.event, JSON.parse(event.data) as Record<string, unknown>);
        return event.event === "ended";
      }, control.signal);
      return;
    }
    // Events between the first request and the opening of the stream.
    if (await look()) news.stop();
  };
  start().catch((error: unknown) => {
    if (!control.signal.aborted) onError(error);
  });
  return () => control.abort();
}
