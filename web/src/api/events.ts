/**
 * Events of jobs: server-sent events, read with `fetch`, which passes on every kind and lets us resume at a given event.
 *
 * A broken stream is resumed after its last event: none is missed, none is duplicated.
 */
import { back, lost, onBack } from "./connection";
import { problemOf, sentenceOf } from "./problem";
import { signedIn } from "./session";

export interface ServerEvent {
  id: string;
  event: string;
  data: string;
}

/** The server sends something at least every 15 s. */
const SILENCE_MS = 40_000;

/** Parses a stream of text into events (WHATWG HTML, 9.2.6). */
export class EventParser {
  private rest = "";
  private fields: ServerEvent = { id: "", event: "", data: "" };
  private lines: string[] = [];

  /** The events completed by this chunk. */
  push(piece: string): ServerEvent[] {
    const found: ServerEvent[] = [];
    this.rest += piece;
    const lines = this.rest.split(/\r\n|\n|\r/);
    this.rest = lines.pop() ?? "";
    for (const line of lines) {
      if (line === "") {
        if (this.lines.length > 0) found.push({ ...this.fields, event: this.fields.event || "message", data: this.lines.join("\n") });
        this.fields = { id: this.fields.id, event: "", data: "" };
        this.lines = [];
        continue;
      }
      const colon = line.indexOf(":");
      if (colon === 0) continue;
      const name = colon < 0 ? line : line.slice(0, colon);
      const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
      if (name === "data") this.lines.push(value);
      else if (name === "id") this.fields.id = value;
      else if (name === "event") this.fields.event = value;
    }
    return found;
  }
}

/**
 * Follows a stream until `onEvent` returns true, or `signal` ends it.
 *
 * Throws only if the server refuses; a broken connection is retried.
 */
export async function follow(url: string, onEvent: (event: ServerEvent) => boolean | void, signal: AbortSignal, lastId = ""): Promise<void> {
  let last = lastId;
  let ignore = (): void => undefined;
  while (!signal.aborted) {
    ignore();
    try {
      const headers: Record<string, string> = { accept: "text/event-stream" };
      if (last) headers["last-event-id"] = last;
      const response = await fetch(url, { headers, signal, credentials: "same-origin" });
      if (!response.ok) {
        if (response.status === 401) {
          await signedIn();
          continue;
        }
        const problem = await problemOf(response, `GET ${url}`);
        if (problem.status < 500) throw new Refused(problem);
        throw problem;
      }
      // Not a `TextDecoderStream`: if its source breaks, Chromium reports a rejection that cannot be handled.
      const reader = response.body?.getReader();
      if (!reader) return;
      const decoder = new TextDecoder();
      const parser = new EventParser();
      // A proxy may keep a stream open after its server has died: it is reopened after an outage or a silence.
      // A broken stream rejects the cancel, and is reopened below.
      const renew = () => void reader.cancel().catch(() => undefined);
      const listening = onBack(renew);
      ignore = () => void listening();
      let silence = setTimeout(renew, SILENCE_MS);
      for (;;) {
        const { value, done } = await reader.read().finally(() => clearTimeout(silence));
        if (done) break;
        silence = setTimeout(renew, SILENCE_MS);
        for (const event of parser.push(decoder.decode(value, { stream: true }))) {
          if (event.id) last = event.id;
          if (onEvent(event)) {
            ignore();
            clearTimeout(silence);
            await reader.cancel();
            return;
          }
        }
      }
      // The server ends a stream when there are no more events, or when it shuts down.
      await new Promise((resolve) => setTimeout(resolve, 500));
    } catch (error) {
      ignore();
      if (signal.aborted) return;
      if (error instanceof Refused) throw error.problem;
      console.info(`The event stream broke: ${sentenceOf(error)}`);
      lost();
      await back();
    }
  }
}

class Refused extends Error {
  constructor(readonly problem: Error) {
    super(problem.message);
  }
}
