/** An action started by a click: busy while it lasts, one sentence if it fails. */
import { createSignal } from "solid-js";
import { sentenceOf } from "./problem";

export function createAttempt() {
  const [busy, setBusy] = createSignal(false);
  const [problem, setProblem] = createSignal<string>();
  const attempt = async (what: () => Promise<void>) => {
    setProblem(undefined);
    setBusy(true);
    try {
      await what();
    } catch (error) {
      setProblem(sentenceOf(error));
    } finally {
      setBusy(false);
    }
  };
  return { busy, problem, setProblem, attempt };
}
