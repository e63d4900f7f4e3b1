/** In step 2: a table of another program. Each column's meaning and unit, the clock and the axes, chosen on top of a draft of the server. */
import { For, Show, createEffect, createMemo, createSignal, on } from "solid-js";
import { createAttempt } from "../../api/attempt";
import { type Schemas, ask, get } from "../../api/client";
import type { JobView } from "../../api/job";
import { createLoad } from "../../api/load";
import { count, short } from "../../format";
import { CLOCKS, type Choice, type Column, NOTHING, QUANTITIES, TIME, Table, choiceOf, mayBeTable, numberIn, placesOfFinding } from "../../model/table";
import { findingTitle } from "../../model/twin";
import { Problem, saveText } from "../../parts/bits";
import { createTyped } from "../../typed";
import type { Twin } from "./state";

/** Columns that are shown at once; a table of hundreds is a long page. */
const SHOWN = 60;

export function TableForm(props: { twin: Twin; findings: readonly { kind: string; detail: string }[]; refusal?: string | undefined }) {
  const facts = () => (props.twin.log.job()?.facts ?? {}) as Partial<Schemas["UploadFacts"]>;
  const draft = createLoad(() => props.twin.logs()[0], (id, signal) => get("/api/v1/logs/{id}/mapping", { path: { id }, signal }));
  // By the content of the file: what was chosen is there again when the same file is read again, or dropped again.
  const [stored, store] = createTyped(`table.${facts().xxh3 ?? ""}`);
  const choice = createMemo(() => choiceOf(stored()));
  const change = (next: Partial<Choice>) => {
    setTold(new Map());
    store(JSON.stringify({ ...choice(), ...next }));
  };
  const table = createMemo(() => {
    const found = draft.data();
    return found && new Table(found, choice());
  });
  const [all, setAll] = createSignal(false);
  const { busy, problem, attempt } = createAttempt();
  // What the import said, until something is changed; complaints of this page once it was tried to send them.
  const [told, setTold] = createSignal(new Map<string, string>());
  const [tried, setTried] = createSignal(false);
  createEffect(on([() => props.refusal, () => props.findings, () => draft.data()], () => {
    const shown = table();
    const at = new Map<string, string>();
    if (shown) {
      for (const place of props.refusal === undefined ? [] : shown.placesOf(props.refusal)) at.set(place, props.refusal ?? "");
      for (const finding of props.findings) for (const place of placesOfFinding(shown, finding)) at.set(place, `${findingTitle(finding.kind)}: ${finding.detail}`);
    }
    setTold(at);
  }));
  const wrong = createMemo(() => table()?.wrong() ?? new Map<string, string>());
  const complaint = (field: string) => (tried() ? wrong().get(field) : undefined) ?? told().get(field);
  const mendable = () => props.findings.flatMap((one) => {
    const next = table()?.mended(one);
    return next ? [{ finding: one, next }] : [];
  });
  let form: HTMLFormElement | undefined;
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    setTried(true);
    const shown = table();
    if (!shown) return;
    if (wrong().size > 0) {
      queueMicrotask(() => form?.querySelector<HTMLElement>("[aria-invalid='true']")?.focus());
      return;
    }
    const mapping = shown.mapping();
    void attempt(async () => {
      const again = (id: string) => ask<JobView>("POST", `/api/v1/logs/${id}/import`, { mapping });
      const job = await again(props.twin.logs()[0] ?? "");
      // Other flights of the same logger have the same columns.
      const held = await Promise.all(props.twin.heldRefused().map(async ({ id, file }) => (mayBeTable(file) ? { id, job: await again(id) } : undefined)));
      const named = new Map(held.flatMap((one) => (one ? [[one.id, one.job.id]] : [])));
      props.twin.reread(job.id, props.twin.held().map((id) => named.get(id) ?? id));
    });
  };
  return (
    <div class="say stack" role="group" aria-label="Columns of the table">
      <p>
        <strong>Say what the columns of {facts().file ?? "the table"} are.</strong> What names and numbers say is chosen already; check it, and answer what they leave open. The file is read
        again from the upload as it is, and what you choose here stays.
      </p>
      <Problem sentence={draft.error()} retry={draft.reload} />
      <Show when={draft.loading() && !draft.data()}><p class="muted" role="status">Reading the header and some rows …</p></Show>
      <Show when={table()}>
        {(shown) => (
          <form class="stack" ref={form} aria-label="What the columns are" onSubmit={submit} noValidate>
            <For each={mendable()}>
              {({ finding, next }) => (
                <div class="row">
                  <span><strong>{findingTitle(finding.kind)}:</strong> one of the choices below is wrong.</span>
                  <button type="button" onClick={() => change(next)}>Choose what the finding says<span class="sr">: {findingTitle(finding.kind)}</span></button>
                </div>
              )}
            </For>
            <ColumnTable table={shown()} columns={all() ? shown().draft.columns : shown().draft.columns.slice(0, SHOWN)} complaint={complaint} change={change} />
            <Show when={!all() && shown().draft.columns.length > SHOWN}>
              <div class="row"><button type="button" onClick={() => setAll(true)}>Show all {shown().draft.columns.length} columns</button></div>
            </Show>
            <div class="scroll" tabindex="0" role="region" aria-label="Clock, motors and axes">
              <table class="small meanings">
                <thead><tr><th scope="col">Together</th><th scope="col">Columns</th><th scope="col">How to read them</th></tr></thead>
                <tbody>
                  <Clock table={shown()} complaint={complaint} change={change} />
                  <For each={QUANTITIES.filter((one) => shown().of(one).length > 0 || open(shown(), one.key).length > 0)}>
                    {(quantity) => {
                      const names = () => shown().of(quantity);
                      const drafted = () => shown().draft.rows.find((row) => row.to === quantity.key);
                      return (
                        <tr>
                          <th scope="row">{quantity.title}</th>
                          <td class="named">{names().length > 0 ? names().join(", ") : <span class="muted">none</span>}</td>
                          <td>
                            <Show when={quantity.key === "duty" && names().length > 0}>
                              <div class="fields">
                                <label class="field">Zero throttle<input type="text" inputmode="decimal" size="7" value={shown().low()} aria-invalid={complaint("duty") !== undefined && isAtFault(shown().low(), shown().high())} onInput={(event) => change({ low: event.currentTarget.value })} /></label>
                                <label class="field">Full throttle<input type="text" inputmode="decimal" size="7" value={shown().high()} aria-invalid={complaint("duty") !== undefined && isAtFault(shown().high(), shown().low())} onInput={(event) => change({ high: event.currentTarget.value })} /></label>
                              </div>
                              <Complaint sentence={complaint("duty")} />
                            </Show>
                            <Show when={quantity.frames.length > 0 && names().length > 0}>
                              <select aria-label={`axes of ${quantity.title.toLowerCase()}`} onChange={(event) => change({ frame: { ...choice().frame, [quantity.key]: event.currentTarget.value } })}>
                                <For each={quantity.frames}>{(one) => <option value={one.key} selected={one.key === shown().frame(quantity)}>{one.words}</option>}</For>
                              </select>
                            </Show>
                            <For each={open(shown(), quantity.key)}>{(one) => <p class="small question">{one}</p>}</For>
                            <Show when={drafted()}>{(row) => <p class="small muted">Drafted {row().evidence}.</p>}</Show>
                          </td>
                        </tr>
                      );
                    }}
                  </For>
                </tbody>
              </table>
            </div>
            <details>
              <summary>The same as a mapping file (TOML), for “rotortwin log import --mapping”</summary>
              <pre tabindex="0" aria-label="mapping">{shown().mapping()}</pre>
              <button type="button" onClick={() => saveText(`${(facts().file ?? "table").replace(/\.[^.]*$/, "")}-map.toml`, shown().mapping())}>Save it</button>
            </details>
            <Complaint sentence={tried() ? wrong().get("all") : undefined} />
            <Show when={tried() && wrong().size > 0}><p class="small" role="status">{count(wrong().size, "field")} to put right: each says why.</p></Show>
            <Problem sentence={problem()} />
            <div class="row">
              <button type="submit" class="main" disabled={busy()}>{busy() ? "Asking …" : "Read it so"}</button>
              <Show when={stored() !== ""}><button type="button" disabled={busy()} onClick={() => change(NOTHING_TYPED)}>Back to the draft</button></Show>
            </div>
          </form>
        )}
      </Show>
    </div>
  );
}

const NOTHING_TYPED = { ...NOTHING, clock: undefined, rate: undefined, low: undefined, high: undefined } as unknown as Partial<Choice>;

/** Of two fields with one complaint: which of them it is about. */
const isAtFault = (typed: string, other: string) => numberIn(typed) === undefined || numberIn(other) !== undefined;

const isAnswered = (table: Table, key: string) => QUANTITIES.some((one) => one.key === key && table.of(one).length > 0);

/** Questions of the draft on a quantity. The answer is a choice of this form, so the words on what a file would hold are left out. */
const open = (table: Table, key: string) =>
  table.draft.questions.filter((one) => one.about === key && !(isAnswered(table, key) && one.sentence.startsWith("no columns"))).map((one) => {
    const sentence = one.sentence.replaceAll("is written here", "is chosen here").replaceAll("are written here", "are chosen here");
    return /[.?]$/.test(sentence) ? sentence : `${sentence}.`;
  });

function Complaint(props: { sentence: string | undefined }) {
  return <div role="alert"><Show when={props.sentence}><p class="small complaint">{props.sentence}</p></Show></div>;
}

function ColumnTable(props: { table: Table; columns: readonly Column[]; complaint: (field: string) => string | undefined; change: (next: Partial<Choice>) => void }) {
  // A mapping names columns: of several with one name it reaches the first.
  const isFirst = (column: Column, place: number) => props.table.draft.columns.findIndex((one) => one.name === column.name) === place;
  return (
    <div class="scroll" tabindex="0" role="region" aria-label="Columns">
      <table class="small meanings">
        <thead><tr><th scope="col">Column</th><th scope="col">What it is</th><th scope="col">Unit</th></tr></thead>
        <tbody>
          <For each={props.columns}>
            {(column, place) => {
              const meaning = () => props.table.meaning(column.name);
              const quantity = () => props.table.quantity(column.name);
              const complaint = () => props.complaint(`column ${column.name}`);
              return (
                <tr classList={{ unused: meaning() === "" }}>
                  <th scope="row">
                    <code class="break">{column.name}</code>
                    <div class="muted small num">{factsOf(column)}</div>
                  </th>
                  <Show when={isFirst(column, place())} fallback={<td colspan="2" class="muted">not used: a column before it has the same name; rename one in the file</td>}>
                    <td>
                      <select
                        aria-label={`meaning of ${column.name}`}
                        aria-invalid={complaint() !== undefined}
                        onChange={(event) => props.change({ meaning: { ...props.table.choice.meaning, [column.name]: event.currentTarget.value } })}
                      >
                        <option value="" selected={meaning() === ""}>not used</option>
                        <option value={TIME} selected={meaning() === TIME}>time</option>
                        <For each={QUANTITIES}>
                          {(one) => (
                            <optgroup label={one.title}>
                              <For each={one.parts}>{([part, words]) => <option value={part} selected={meaning() === part}>{words}</option>}</For>
                            </optgroup>
                          )}
                        </For>
                      </select>
                      <Complaint sentence={complaint()} />
                    </td>
                    <td>
                      <Show when={(quantity()?.units.length ?? 0) > 0 && quantity()}>
                        {(one) => (
                          <select aria-label={`unit of ${column.name}`} onChange={(event) => props.change({ unit: { ...props.table.choice.unit, [column.name]: event.currentTarget.value } })}>
                            <For each={one().units}>{([unit, words]) => <option value={unit} selected={unit === props.table.unit(column.name)}>{words}</option>}</For>
                          </select>
                        )}
                      </Show>
                    </td>
                  </Show>
                </tr>
              );
            }}
          </For>
        </tbody>
      </table>
    </div>
  );
}

/** What of a column helps to recognise it. */
function factsOf(column: Column): string {
  if (column.low == null || column.high == null) return column.examples.map((cell) => `“${cell}”`).join(", ");
  const range = column.low === column.high ? `always ${short(column.low, 5)}` : `${short(column.low, 5)} to ${short(column.high, 5)}`;
  return column.numbers < column.cells ? `${range}; ${column.cells - column.numbers} of ${column.cells} cells are no numbers` : range;
}

function Clock(props: { table: Table; complaint: (field: string) => string | undefined; change: (next: Partial<Choice>) => void }) {
  const time = () => props.table.columns(TIME)[0];
  return (
    <tr>
      <th scope="row">Time</th>
      <td class="named">{time() ?? <span class="muted">none</span>}</td>
      <td>
        <Show
          when={time()}
          fallback={
            <>
              <label class="field">Rows per second<input type="text" inputmode="decimal" size="7" value={props.table.rate()} aria-invalid={props.complaint("rate") !== undefined} onInput={(event) => props.change({ rate: event.currentTarget.value })} /></label>
              <Complaint sentence={props.complaint("rate")} />
            </>
          }
        >
          <select aria-label="how the time is written" aria-invalid={props.complaint("clock") !== undefined} onChange={(event) => props.change({ clock: event.currentTarget.value })}>
            <For each={CLOCKS}>{([key, words]) => <option value={key} selected={key === props.table.clock()}>{words}</option>}</For>
          </select>
          <Complaint sentence={props.complaint("clock")} />
        </Show>
        <For each={open(props.table, "clock")}>{(one) => <p class="small question">{one}</p>}</For>
        <p class="small muted">Drafted: {props.table.draft.layout.evidence}.</p>
      </td>
    </tr>
  );
}
