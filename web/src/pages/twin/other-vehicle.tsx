/** Where a model and a flight do not go together: another vehicle is the way on. */
import { Show } from "solid-js";
import type { Twin } from "./state";

export function OtherVehicle(props: { twin: Twin; when: boolean }) {
  return (
    <Show when={props.when}>
      <div class="row">
        <button type="button" class="main" onClick={() => props.twin.openFromLog()}>Make the vehicle from this {props.twin.logs().length > 0 ? "log" : "run"}</button>
        <span class="small">Its mass and its size are enough. Or choose another one in <a href="#step-3">step 3</a>.</span>
      </div>
    </Show>
  );
}
