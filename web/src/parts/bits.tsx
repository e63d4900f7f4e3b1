/** Small components that pages share. */
import { For, type JSX, Show, createSignal } from "solid-js";
import type { Load } from "../api/load";

/** State of a job as a word with a colour. */
export function StatusTag(props: { status: string }) {
  const kind = () => ({ done: "good", failed: "bad", canceled: "warn", running: "live", queued: "" })[props.status] ?? "";
  return <span class={`tag ${kind()}`}>{props.status}</span>;
}

/** A text with `names` of keys and commands in backticks, as code. */
export function Words(props: { text: string }) {
  return <For each={props.text.split("`")}>{(part, place) => (place() % 2 === 1 ? <code>{part}</code> : <>{part}</>)}</For>;
}

/** An error message, shown where it belongs. */
export function Problem(props: { sentence: string | undefined; complaints?: readonly string[] | undefined; retry?: () => void }) {
  return (
    <div role="alert">
      <Show when={props.sentence}>
        <div class="say bad">
          {props.sentence}
          <Show when={(props.complaints?.length ?? 0) > 1}>
            <ul>
              <For each={props.complaints}>{(one) => <li>{one}</li>}</For>
            </ul>
          </Show>
          <Show when={props.retry}>
            {" "}
            <button type="button" onClick={() => props.retry?.()}>Try again</button>
          </Show>
        </div>
      </Show>
    </div>
  );
}

/** The data, the reason why there are none, or a loading indicator. */
export function Loaded<T>(props: { load: Load<T>; children: (data: () => T) => JSX.Element; what: string }) {
  return (
    <>
      <Problem sentence={props.load.error()} retry={props.load.reload} />
      <Show when={props.load.data()} fallback={<Show when={props.load.loading()}><p class="muted">Loading {props.what} …</p></Show>}>
        {(data) => props.children(data as () => T)}
      </Show>
    </>
  );
}

/** Copies a text and confirms it. */
export function Copy(props: { text: () => string; label: string }) {
  const [said, setSaid] = createSignal("");
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(props.text());
      setSaid("copied");
    } catch {
      setSaid("the browser does not allow it; select the text below");
    }
    setTimeout(() => setSaid(""), 2500);
  };
  return (
    <span>
      <button type="button" onClick={() => void copy()}>{props.label}</button>
      <span role="status" class="small muted"> {said()}</span>
    </span>
  );
}

/** Saves a text as a file. */
export function saveText(name: string, text: string): void {
  const url = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}

/** A title with its content. */
export function Panel(props: { title: string; note?: string | undefined; actions?: JSX.Element; children: JSX.Element; id?: string }) {
  return (
    <section class="panel" aria-label={props.title} {...(props.id ? { id: props.id } : {})}>
      <div class="head">
        <h2>{props.title}</h2>
        <Show when={props.note}><span class="note">{props.note}</span></Show>
        <span class="grow" />
        {props.actions}
      </div>
      {props.children}
    </section>
  );
}

/** Figures in a row: name and value. */
export function Figures(props: { items: readonly (readonly [string, JSX.Element])[] }) {
  return (
    <dl class="figures">
      <For each={props.items}>{([name, value]) => <div><dt>{name}</dt><dd>{value}</dd></div>}</For>
    </dl>
  );
}

/** A progress bar; without a share it only shows activity. */
export function Progress(props: { share: number | undefined; what: string }) {
  // Two elements: the property `value` must be a number.
  return (
    <Show when={props.share !== undefined} fallback={<progress max="1" aria-label={props.what} />}>
      <progress max="1" value={props.share ?? 0} aria-label={props.what} />
    </Show>
  );
}
