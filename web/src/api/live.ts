/** Live samples of a run over a WebSocket; a broken connection resumes after the last sample. */
import type { Schemas } from "./client";
import { answers, back, lost } from "./connection";

export type LiveMessage = Schemas["LiveMessage"];

/** A sample earlier than the previous one by this much belongs to another attempt, s. */
export const FLOWN_AGAIN_S = 1;

/** Consecutive refused connections after which to give up. */
const REFUSALS = 3;

/** Watches a run from the sample after `last` (0: from the first one) until it ends; returns a function that stops it. */
export function watchLive(run: string, channels: string, rateHz: number, last: number, onMessage: (message: LiveMessage) => void): () => void {
  let stopped = false;
  let socket: WebSocket | undefined;
  // A server without a history refuses `from_s` before the connection is established.
  let history = true;
  let refusals = 0;
  const connect = () => {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const query = new URLSearchParams({ channels, rate_hz: String(rateHz) });
    if (history) query.set("from_s", String(last));
    socket = new WebSocket(`${scheme}//${location.host}/api/v1/runs/${run}/live?${query}`);
    let [opened, ended] = [false, false];
    socket.onopen = () => {
      opened = true;
    };
    socket.onmessage = (event) => {
      const message = JSON.parse(String(event.data)) as LiveMessage;
      if (message.type === "sample") {
        // It is flown again, and its beginning was sent while we were not connected: request all of it.
        if (history && message.time_s + FLOWN_AGAIN_S < last) {
          last = 0;
          if (socket) socket.onclose = null;
          socket?.close();
          connect();
          return;
        }
        last = message.time_s;
      }
      if (message.type === "history") last = message.time_s.at(-1) ?? last;
      if (message.type === "end") ended = true;
      onMessage(message);
    };
    socket.onclose = () => {
      if (stopped || ended) return;
      void answers().then((there) => {
        if (stopped) return;
        // A server that is just back may have refused because it was down: only one that keeps refusing has no history.
        refusals = there && !opened ? refusals + 1 : 0;
        if (refusals >= REFUSALS && history) {
          history = false;
          onMessage({ type: "error", detail: "This server keeps no history of live samples: what flew before this page was opened is missing until the run has ended." });
          connect();
          return;
        }
        if (!there) lost();
        void back().then(() => setTimeout(() => stopped || connect(), 500));
      });
    };
  };
  connect();
  return () => {
    stopped = true;
    socket?.close();
  };
}
