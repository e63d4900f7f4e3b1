/** An improvement: additions of each version, and how the error decreased. */
import { For, Show } from "solid-js";
import { plusMinus, short } from "../format";
import type { Improvement } from "../model/twin";
import { Panel } from "../parts/bits";
import { type Fall, Falls } from "../plots/falls";
import { DiagnosisView } from "./diagnosis";

/** Quantities of the bars, in addition to open loop. */
const QUANTITIES = ["force", "torque", "voltage"];
/** Horizon of the open-loop bars, s. */
const HORIZON_S = 1;

export function ImprovementView(props: { result: Improvement }) {
  const it = () => props.result;
  const logs = () => it().rows[0]?.logs ?? [];
  const falls = (place: number): Fall[] => {
    const name = (row: Improvement["rows"][number]) => (row.oracle ? row.version : row.version.replace(/^.*@/, ""));
    const quantities = (logs()[place]?.errors ?? []).filter((one) => QUANTITIES.includes(one.quantity));
    const found: Fall[] = quantities.map((one) => ({
      title: one.quantity,
      unit: one.unit,
      noise: one.noise ?? null,
      rows: it().rows.map((row) => ({ name: name(row), error: row.logs[place]?.errors.find((other) => other.quantity === one.quantity)?.error ?? null })),
    }));
    const far = it().rows.map((row) => ({ name: name(row), error: row.logs[place]?.open_loop.find((one) => Math.abs(one.horizon_s - HORIZON_S) < 1e-9)?.position_m ?? null }));
    if (far.some((one) => one.error !== null)) found.push({ title: `open loop, position after ${HORIZON_S} s`, unit: "m", noise: null, rows: far });
    return found;
  };
  return (
    <>
      <div class={`say sentence ${it().end === "agrees" ? "good" : "warn"}`}>{it().reason}</div>
      <Show when={it().next_flight}><div class="say warn">{it().next_flight}</div></Show>
      <Panel title="Versions" note="± is the 95 % interval">
        <div class="scroll" tabindex="0" role="region" aria-label="Versions of the model">
          <table class="small">
            <thead><tr><th scope="col">Version</th><th scope="col">Added</th><th scope="col">Parameters</th><th class="r" scope="col">ln Bayes factor</th><th scope="col">Hash</th></tr></thead>
            <tbody>
              <For each={it().rows}>
                {(row) => (
                  <tr>
                    <td>{row.version}<Show when={row.oracle}> <span class="tag">the truth</span></Show></td>
                    <td>{row.added ?? "the vehicle as given"}</td>
                    <td class="num">{row.parameters.map((one) => `${one.symbol} = ${plusMinus(one.value, one.interval_95, one.unit)}`).join("; ")}</td>
                    <td class="r">{typeof row.ln_bayes_factor === "number" ? short(row.ln_bayes_factor) : ""}</td>
                    <td class="mono">{row.hash.slice(0, 8)}</td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
        <ul class="small"><For each={it().rows.flatMap((row) => row.remarks)}>{(one) => <li>{one}</li>}</For></ul>
      </Panel>
      <For each={logs()}>
        {(log, place) => (
          <Panel title={log.log} note={log.held_out ? "held out: no fit has seen it" : "fitted"}>
            <div class="falls"><For each={falls(place())}>{(one) => <Falls fall={one} />}</For></div>
          </Panel>
        )}
      </For>
      <Show when={it().diagnosis}>
        {(found) => <Panel title="The last diagnosis" note={found().model.name}><div class="stack"><DiagnosisView found={found()} /></div></Panel>}
      </Show>
      <p class="small muted">Errors are root mean squares of means over 0.1 s; rotor biases and the charge at the start are fitted to each log for each version.</p>
    </>
  );
}
