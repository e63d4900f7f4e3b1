/** How well the constants of a vehicle of the library are known: value, 95 % interval and source of each. */
import { Show } from "solid-js";
import { get, text as fetchText } from "../api/client";
import { createLoad } from "../api/load";
import { constantsOf } from "../model/constants";
import { answerOf, inOrder } from "../model/identify";
import { Loaded } from "../parts/bits";
import { Advice, ValueTable } from "./identified";

/** `edition` changes when the document was saved again. */
export function Known(props: { vehicle: string; edition?: number }) {
  const known = createLoad(
    () => ({ name: props.vehicle, edition: props.edition }),
    async ({ name }, signal) => {
      const model = encodeURIComponent(name);
      // Version 0 of the model of a vehicle is the vehicle, with its intervals; a model of the same name takes precedence.
      const [version, models] = await Promise.all([fetchText(`/api/v1/models/${model}/versions/v0`), get("/api/v1/models", { signal })]);
      return { values: constantsOf(version), ofModel: models.items.includes(name) };
    },
  );
  return (
    <Loaded load={known} what="what is known of it">
      {(found) => (
        <div class="stack">
          <Show when={found().ofModel}><p class="small">There is a model called {props.vehicle}, too: what is said here is of its version 0.</p></Show>
          <Show when={found().values.length > 0} fallback={<p class="muted">Its document says nothing of how well its values are known: each is taken as exact.</p>}>
            <div class={`say ${answerOf(found().values).kind}`}><strong>{answerOf(found().values).head}</strong> {answerOf(found().values).rest}</div>
            <Advice values={found().values} />
            <ValueTable values={inOrder(found().values)} label={`Known values of ${props.vehicle}`} />
          </Show>
        </div>
      )}
    </Loaded>
  );
}
