/** Step 2: the data read from the log, what is missing and what that rules out, what looks wrong and how to repair it. */
import { For, Show, createMemo, createSignal } from "solid-js";
import type { Schemas } from "../../api/client";
import { duration, short } from "../../format";
import { adviceFor, isChosen, isOfMotors, sourceOf, suggestionOfRefusal } from "../../model/repair";
import { mayBeTable } from "../../model/table";
import { findingBlocks, findingTitle } from "../../model/twin";
import { Figures } from "../../parts/bits";
import { Repair } from "./repair";
import { isTyped } from "../../typed";
import { Step } from "./step";
import { TableForm } from "./table";
import type { Twin } from "./state";

export function Read(props: { twin: Twin }) {
  const result = () => props.twin.log.result();
  const report = () => result()?.report;
  const blocking = createMemo(() => (report()?.findings ?? []).filter((one) => findingBlocks(one.kind)));
  const [otherwise, setOtherwise] = createSignal(false);
  const [columns, setColumns] = createSignal(false);
  // A consistent log may still not fit the vehicle: the comparison says so.
  const motors = () => (isOfMotors(props.twin.comparison.error() ?? "") ? props.twin.comparison.error() : undefined);
  const refusal = () => (props.twin.log.job()?.status === "failed" ? props.twin.log.error() : undefined);
  const facts = () => (props.twin.log.job()?.facts ?? {}) as Partial<Schemas["UploadFacts"]>;
  // A table that was read by columns which its owner chose is read again in the same way, whatever is wrong with it.
  const isMapped = () => result()?.source.kind === "mapped_csv";
  const asTable = () => refusal() !== undefined && mayBeTable(facts().file ?? "") && (props.twin.ofAnotherProgram() || isTyped(`table.${facts().xxh3 ?? ""}`));
  // A file refused for a unit or a checksum can be imported with other settings.
  const mendable = () => {
    const words = asTable() ? undefined : refusal();
    return words !== undefined && (isChosen(suggestionOfRefusal(words)) || /CRC|checksum|damaged/.test(words)) ? words : undefined;
  };
  // A table whose header is that of a log, or almost: its owner may know better.
  const couldBeTable = () => refusal() !== undefined && !asTable() && mayBeTable(facts().file ?? "");
  const swapped = createMemo(() => (motors() ? [{ kind: "swapped_motors", detail: motors() ?? "" }] : []));
  // A log without a flight is not repaired: another one is the way on.
  const hopeless = () => (blocking().some((one) => one.kind === "no_flight" || one.kind === "one_column") ? adviceFor(blocking()[0]?.kind ?? "", sourceOf(result()?.source.kind, facts().file ?? "")) : undefined);
  const isRun = () => props.twin.runs().length > 0;
  return (
    <Step
      number={2}
      title="What I read"
      later="columns, rate, gaps; what is missing in the log and what that rules out"
      state={isRun() ? "done" : mendable() || asTable() || couldBeTable() ? "problem" : result() === undefined ? "waiting" : blocking().length > 0 ? "problem" : "done"}
      note={isRun() ? "a run of this server: every channel, without gaps" : result()?.headline.replace(/^\w+: /, "")}
    >
      <Show when={report()}>
        {(found) => (
          <>
            <For each={found().findings}>
              {(one) => (
                <div class={`say ${findingBlocks(one.kind) ? "bad" : "warn"}`}>
                  <strong>{findingTitle(one.kind)}.</strong> {one.detail}
                </div>
              )}
            </For>
            <Show when={blocking().length > 0}>
              <Show
                when={isMapped()}
                fallback={
                  <Show when={hopeless()} fallback={<Repair twin={props.twin} findings={blocking()} />}>
                    {(advice) => (
                      <>
                        <div class="row">
                          <span>{advice()}</span>
                          <button type="button" class="main" onClick={() => props.twin.choose({})}>Choose another log</button>
                        </div>
                        <details onToggle={(event) => setOtherwise(event.currentTarget.open)}>
                          <summary>Or say what its columns really hold, if they were read wrongly</summary>
                          <Show when={otherwise()}><Repair twin={props.twin} findings={blocking()} /></Show>
                        </details>
                      </>
                    )}
                  </Show>
                }
              >
                <TableForm twin={props.twin} findings={blocking()} />
              </Show>
            </Show>
            <Figures
              items={[
                ["rows", found().rows.toLocaleString("en")],
                ["rate", `${short(found().sample_rate_hz)} Hz`],
                ["length", duration(found().rows / found().sample_rate_hz)],
                ["gaps", found().gaps.length === 0 ? "none" : `${found().gaps.length}, longest ${short(Math.max(...found().gaps.map((gap) => gap.end_s - gap.start_s)))} s`],
                ["groups of columns missing", String(found().missing.length)],
              ]}
            />
            <Show when={found().missing.length > 0}>
              <div class="scroll" tabindex="0" role="region" aria-label="Missing columns">
                <table class="small">
                  <thead><tr><th scope="col">Missing</th><th scope="col">What that rules out</th></tr></thead>
                  <tbody>
                    <For each={found().missing}>{(one) => <tr><td><code>{one.columns.join(", ")}</code></td><td>{one.rules_out}</td></tr>}</For>
                  </tbody>
                </table>
              </div>
            </Show>
            <details>
              <summary>Delays, conversions, unused columns</summary>
              <div class="two">
                <div class="scroll" tabindex="0" role="region" aria-label="Delays">
                  <table class="small">
                    <thead><tr><th scope="col">Signal</th><th scope="col">behind</th><th class="r" scope="col">delay, ms</th><th class="r" scope="col">± ms, 95 %</th></tr></thead>
                    <tbody>
                      <For each={found().delays} fallback={<tr><td colspan="4" class="muted">none could be estimated</td></tr>}>
                        {(one) => (
                          <tr><td>{one.signal}{one.applied ? " (taken out)" : ""}</td><td>{one.against}</td><td class="r">{short(1e3 * one.delay_s)}</td><td class="r">{short(1.96e3 * one.uncertainty_s)}</td></tr>
                        )}
                      </For>
                    </tbody>
                  </table>
                </div>
                <ul class="small">
                  <For each={[...found().conversions, ...found().notes]}>{(one) => <li>{one}</li>}</For>
                  <For each={found().unused_columns}>{(one) => <li><code>{one.column}</code>: {one.reason}</li>}</For>
                  <For each={found().streams}>{(one) => <li>{one.name}: {one.samples} samples at {short(one.sample_rate_hz)} Hz, {one.resampling}</li>}</For>
                  <For each={found().missing_cells}>{(one) => <li><code>{one.column}</code>: {one.cells} cells without a value</li>}</For>
                </ul>
              </div>
            </details>
            <Show when={blocking().length === 0}>
              <details onToggle={(event) => setOtherwise(event.currentTarget.open)} open={motors() !== undefined}>
                <summary>Read it again otherwise: {isMapped() ? "what each column is, units, axes, the clock" : "axes, units, order of the motors, delays"}</summary>
                <Show when={otherwise() || motors()}>
                  <Show when={isMapped()} fallback={<Repair twin={props.twin} findings={swapped()} />}><TableForm twin={props.twin} findings={swapped()} /></Show>
                </Show>
              </details>
              <Show when={result()?.source.kind === "csv" && mayBeTable(facts().file ?? "")}>
                <details onToggle={(event) => setColumns(event.currentTarget.open)}>
                  <summary>The columns are not what their names say: choose what each is</summary>
                  <Show when={columns()}><TableForm twin={props.twin} findings={[]} /></Show>
                </details>
              </Show>
            </Show>
          </>
        )}
      </Show>
      <Show when={mendable()}>{(words) => <Repair twin={props.twin} findings={[]} refusal={words()} />}</Show>
      <Show when={asTable()}><TableForm twin={props.twin} findings={[]} refusal={props.twin.ofAnotherProgram() ? undefined : refusal()} /></Show>
      <Show when={couldBeTable()}>
        <details onToggle={(event) => setColumns(event.currentTarget.open)}>
          <summary>It is a table of another program: choose what its columns are</summary>
          <Show when={columns()}><TableForm twin={props.twin} findings={[]} refusal={refusal()} /></Show>
        </details>
      </Show>
    </Step>
  );
}
