/** Step 2: what was read of the log, what is missing and what that rules out, what looks wrong and how to repair it. */
import { For, Show, createSignal } from "solid-js";
import { ask } from "../../api/client";
import type { JobView } from "../../api/job";
import { sentenceOf } from "../../api/problem";
import { duration, short } from "../../format";
import { findingBlocks, findingTitle } from "../../model/twin";
import { Figures, Problem } from "../../parts/bits";
import { Step } from "./step";
import type { Twin } from "./state";

export function Read(props: { twin: Twin }) {
  const result = () => props.twin.log.result();
  const report = () => result()?.report;
  const blocking = () => (report()?.findings ?? []).filter((one) => findingBlocks(one.kind));
  const isRun = () => props.twin.runs().length > 0;
  return (
    <Step
      number={2}
      title="What I read"
      state={isRun() ? "done" : result() === undefined ? "waiting" : blocking().length > 0 ? "problem" : "done"}
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
            <Show when={blocking().length > 0}><Repair twin={props.twin} /></Show>
            <Figures
              items={[
                ["rows", found().rows.toLocaleString("en")],
                ["rate", `${short(found().sample_rate_hz)} Hz`],
                ["length", duration(found().rows / found().sample_rate_hz)],
                ["gaps", found().gaps.length === 0 ? "none" : `${found().gaps.length}, longest ${short(Math.max(...found().gaps.map((gap) => gap.end_s - gap.start_s)))} s`],
                ["missing groups", String(found().missing.length)],
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
                    <thead><tr><th scope="col">Signal</th><th scope="col">behind</th><th class="r" scope="col">delay, ms</th><th class="r" scope="col">± ms</th></tr></thead>
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
          </>
        )}
      </Show>
    </Step>
  );
}

/** The same file, read again otherwise. */
function Repair(props: { twin: Twin }) {
  const [mapping, setMapping] = createSignal("");
  const [problem, setProblem] = createSignal<string>();
  const [busy, setBusy] = createSignal(false);
  const again = async (how: Record<string, unknown>) => {
    setBusy(true);
    setProblem(undefined);
    try {
      const job = await ask<JobView>("POST", `/api/v1/logs/${props.twin.logs()[0]}/import`, how);
      props.twin.choose({ logs: [job.id] });
    } catch (error) {
      setProblem(sentenceOf(error));
    } finally {
      setBusy(false);
    }
  };
  return (
    <form class="say" onSubmit={(event) => { event.preventDefault(); void again({ mapping: mapping() }); }}>
      <p><strong>Repair.</strong> The file is read again; nothing of it is sent twice. Until then no model is compared with it.</p>
      <label class="field">
        PX4, ArduPilot, Crazyflie: columns, units and order of the motors as rows of a mapping (TOML, as in config/log-mappings). CSV and Parquet
        have fixed names and units: correct the file.
        <textarea rows="4" spellcheck={false} value={mapping()} onInput={(event) => setMapping(event.currentTarget.value)} />
      </label>
      <Problem sentence={problem()} />
      <div class="row">
        <button type="submit" class="main" disabled={busy() || !mapping().trim()}>{busy() ? "Reading …" : "Read again"}</button>
        <button type="button" disabled={busy()} onClick={() => void again({ align: true })}>Take out the delays</button>
        <button type="button" disabled={busy()} onClick={() => void again({ vehicle: props.twin.vehicle() })}>Check against {props.twin.vehicle()}</button>
      </div>
    </form>
  );
}
