/**
 * Which of this browser's open pages is in use, and whether this one is visible at all.
 *
 * Plots that follow a flight are drawn for a viewer. Where several pages follow one, they share a processor: the page used last draws
 * every frame, those in windows next to it slow down if frames are late, so that clicks are handled at once. A hidden page draws nothing.
 */
import { createSignal } from "solid-js";

const CHANNEL = "rotortwin.front";
const [front, setFront] = createSignal(true);
const [seen, setSeen] = createSignal(document.visibilityState !== "hidden");

/** Whether this is the page used last. */
export { front };
/** Whether it is visible: not behind another tab. */
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
