/**
 * The caller's FDI sessions as they change: one event stream for all tabs of a browser, as for the jobs ([`news`](./news.ts)).
 *
 * The tab that reads the stream sends all sessions to the others at each change: there are few, and whoever comes late misses nothing.
 */
import type { Schemas } from "./client";
import { follow } from "./events";
import { sentenceOf } from "./problem";

export type Session = Schemas["SessionView"];

const CHANNEL = "rotortwin.fdi";

/** The sessions after one more event of the stream, ordered by id. */
export function after(sessions: readonly Session[], event: string, data: unknown): readonly Session[] {
  if (event === "open") return (data as { items: Session[] }).items;
  const { id } = data as { id: string };
  const others = sessions.filter((one) => one.id !== id);
  return event === "closed" ? others : [...others, data as Session].sort((a, b) => (a.id < b.id ? -1 : 1));
}

/** Calls `onSessions` with all open sessions, now and whenever one changes; returns a function that stops it. */
export function watchSessions(onSessions: (sessions: readonly Session[]) => void, onRefusal: (sentence: string) => void): () => void {
  const control = new AbortController();
  const channel = new BroadcastChannel(CHANNEL);
  channel.onmessage = (message) => message.data !== "anybody" && onSessions(message.data as readonly Session[]);
  const read = async () => {
    let sessions: readonly Session[] | undefined;
    channel.onmessage = (message) => message.data === "anybody" && sessions && channel.postMessage(sessions);
    try {
      await follow("/api/v1/fdi/events", (event) => {
        sessions = after(sessions ?? [], event.event, JSON.parse(event.data));
        channel.postMessage(sessions);
        onSessions(sessions);
      }, control.signal);
    } catch (error) {
      onRefusal(sentenceOf(error));
    }
  };
  // A browser has no locks on a page without HTTPS of another host: each tab reads for itself.
  if (navigator.locks) {
    // Rejected if this tab stops before it was its turn.
    navigator.locks.request(CHANNEL, { signal: control.signal }, read).catch(() => undefined);
    channel.postMessage("anybody");
  } else void read();
  return () => {
    control.abort();
    channel.close();
  };
}
