/**
 * Which of this browser's open pages somebody works with, and whether this one is seen at all.
 *
 * Pictures that follow a flight are drawn for whoever looks. Where several pages follow one, the processor that draws them is shared: the
 * one that was touched last draws each picture, those in windows beside it step back where pictures come late, so that a click is answered
 * at once. A page that nobody sees draws nothing.
 */
import { createSignal } from "solid-js";

const CHANNEL = "rotortwin.front";
const [front, setFront] = createSignal(true);
const [seen, setSeen] = createSignal(document.visibilityState !== "hidden");

/** Whether this is the page that was touched last. */
export { front };
/** Whether it can be seen: no other tab lies over it. */
export { seen };

const channel = typeof BroadcastChannel === "undefined" ? undefined : new BroadcastChannel(CHANNEL);
const claim = () => {
  setFront(true);
  channel?.postMessage("mine");
};
if (channel) {
  channel.onmessage = () => setFront(false);
  for (const touch of ["focus", "pointerdown", "keydown"] as const) addEventListener(touch, claim, { capture: true, passive: true });
  if (seen() && document.hasFocus()) claim();
}
document.addEventListener("visibilitychange", () => {
  setSeen(document.visibilityState !== "hidden");
  if (seen()) claim();
});
