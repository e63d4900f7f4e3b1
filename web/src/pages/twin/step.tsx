/** A step of the loop: its number, whether it is done, its content; a preview (`later`) while it waits for the steps above. */
import { type JSX, Show } from "solid-js";

export type StepState = "waiting" | "working" | "done" | "problem";

export function Step(props: { number: number; title: string; state: StepState; note?: string | undefined; later: string; actions?: JSX.Element; children?: JSX.Element }) {
  const words = () => ({ waiting: "waits for the steps above", working: "working", done: "done", problem: "needs you" })[props.state];
  return (
    <section class={`panel step ${props.state}`} id={`step-${props.number}`} aria-labelledby={`step-${props.number}-title`}>
      <div class="head">
        <span class="no" aria-hidden="true">{props.number}</span>
        <h2 id={`step-${props.number}-title`}>{props.title}<span class="sr">, step {props.number} of 6: {words()}</span></h2>
        <Show when={props.state === "waiting" ? props.later : props.note}>{(words) => <span class="note">{words()}</span>}</Show>
        <span class="grow" />
        {props.actions}
      </div>
      <Show when={props.state !== "waiting"}><div class="stack">{props.children}</div></Show>
    </section>
  );
}
