/** In step 2: the same file imported with corrected meanings of its columns. */
import { For, Show, createEffect, createMemo, createSignal, on } from "solid-js";
import { createAttempt } from "../../api/attempt";
import { type Schemas, ask } from "../../api/client";
import type { JobView } from "../../api/job";
import { createLoad } from "../../api/load";
import {
  type Axes, type Choice, type Finding, type GroupKey, type SourceName, AS_IS, GROUPS, adviceFor, axesText, isChosen, mappingOf, orderOf, sameAxes, sourceOf, suggestionOf,
  suggestionOfRefusal,
} from "../../model/repair";
import { findingTitle } from "../../model/twin";
import { Problem } from "../../parts/bits";
import type { Twin } from "./state";

const SOURCE_WORDS: Record<SourceName, string> = {
  "px4-ulog": "PX4 log", "ardupilot-dataflash": "ArduPilot log", "crazyflie-usdlog": "Crazyflie log", blackbox: "blackbox log", "mavlink-tlog": "MAVLink telemetry log",
  ros2: "ROS 2 recording", "run-mcap": "recording of a simulated run", canonical: "table",
};
/** The built-in rows, which a choice changes; loaded on demand. */
const BUILT_IN: Record<SourceName, () => Promise<{ default: string }>> = {
  "px4-ulog": () => import("../../../../config/log-mappings/px4-ulog.toml?raw"),
  "ardupilot-dataflash": () => import("../../../../config/log-mappings/ardupilot-dataflash.toml?raw"),
  "crazyflie-usdlog": () => import("../../../../config/log-mappings/crazyflie-usdlog.toml?raw"),
  blackbox: () => import("../../../../config/log-mappings/blackbox.toml?raw"),
  "mavlink-tlog": () => import("../../../../config/log-mappings/mavlink-tlog.toml?raw"),
  ros2: () => import("../../../../config/log-mappings/ros2.toml?raw"),
  "run-mcap": () => import("../../../../config/log-mappings/run-mcap.toml?raw"),
  canonical: () => Promise.resolve({ default: "" }),
};

export function Repair(props: { twin: Twin; findings: readonly Finding[]; refusal?: string | undefined }) {
  const facts = () => (props.twin.log.job()?.facts ?? {}) as Partial<Schemas["UploadFacts"]>;
  const source = () => sourceOf(props.twin.log.result()?.source.kind, facts().file ?? props.twin.log.job()?.name ?? "");
  const builtIn = createLoad(source, async (name) => (await BUILT_IN[name]()).default);
  const rotors = () => props.twin.rotorsOfFlight() ?? 0;
  const [choice, setChoice] = createSignal<Choice>({ axes: {}, units: {} });
  const [order, setOrder] = createSignal("");
  const [time, setTime] = createSignal("");
  const [typed, setTyped] = createSignal<string>();
  const { busy, problem, setProblem, attempt } = createAttempt();
  const suggestion = createMemo(() => (props.refusal === undefined ? suggestionOf(props.findings, rotors()) : suggestionOfRefusal(props.refusal)));
  createEffect(on(suggestion, (found) => {
    setChoice({ axes: { ...found.axes }, units: { ...found.units } });
    if (found.order) setOrder(found.order.join(", "));
    if (found.time) setTime(String(found.time));
  }));
  const whole = createMemo<Choice>(() => ({ ...choice(), order: orderOf(order()), time: Number(time()) > 0 ? Number(time()) : undefined }));
  const mapping = () => typed() ?? mappingOf(source(), whole(), builtIn.data() ?? "", rotors()) ?? "";
  const axesOf = (key: GroupKey) => choice().axes[key] ?? AS_IS;
  const optionsOf = (key: GroupKey): (readonly [string, Axes])[] => {
    const known = GROUPS.find((group) => group.key === key)?.axes ?? [];
    const found = suggestion().axes[key];
    return found && !known.some(([, axes]) => sameAxes(axes, found)) ? [...known, [`as the finding says: ${axesText(found)}`, found]] : [...known];
  };
  const chooseAxes = (key: GroupKey, place: number) => setChoice({ ...choice(), axes: { ...choice().axes, [key]: optionsOf(key)[place]?.[1] ?? AS_IS } });
  const chooseUnit = (key: GroupKey, unit: string) => {
    const units = { ...choice().units };
    if (unit === "") delete units[key];
    else units[key] = unit;
    setChoice({ ...choice(), units });
  };
  const wrong = () => {
    if (order().trim() !== "" && !orderOf(order())) return `Order of the motors: '${order()}' is no list of different numbers from 1, such as 3, 2, 1, 4.`;
    if (time().trim() !== "" && !(Number(time()) > 0)) return `Time stamps: '${time()}' is no number above 0.`;
    return undefined;
  };
  const again = (how: Record<string, unknown>) => attempt(async () => {
    const job = await ask<JobView>("POST", `/api/v1/logs/${props.twin.logs()[0]}/import`, how);
    props.twin.reread(job.id);
  });
  const submit = (event: SubmitEvent) => {
    event.preventDefault();
    setProblem(wrong());
    if (!wrong()) void again({ mapping: mapping() });
  };
  const advice = () => props.findings.map((one) => ({ kind: one.kind, words: adviceFor(one.kind, source()) })).filter((one) => one.words !== undefined);
  return (
    <form class="say stack" aria-label="Repair of the log" onSubmit={submit} noValidate>
      <p>
        <strong>Repair: say what the {SOURCE_WORDS[source()]} really holds.</strong> It is read again from the upload; nothing is sent twice, and the file stays as it is.
        <Show when={isChosen(suggestion())}> What the finding suggests is chosen already.</Show>
      </p>
      <For each={advice()}>{(one) => <p class="small"><strong>{findingTitle(one.kind)}:</strong> {one.words}</p>}</For>
      <div class="scroll" tabindex="0" role="region" aria-label="Axes and units">
        <table class="small repair">
          <thead><tr><th scope="col">Columns</th><th scope="col">Axes of the file</th><th scope="col">Unit of the file</th></tr></thead>
          <tbody>
            <For each={GROUPS}>
              {(group) => (
                <tr>
                  <th scope="row">{group.title}</th>
                  <td data-label="Axes of the file">
                    <select aria-label={`axes of ${group.title.toLowerCase()}`} onChange={(event) => chooseAxes(group.key, event.currentTarget.selectedIndex)}>
                      <For each={optionsOf(group.key)}>{([name, axes]) => <option selected={sameAxes(axes, axesOf(group.key))}>{name}</option>}</For>
                    </select>
                  </td>
                  <td data-label="Unit of the file">
                    <select aria-label={`unit of ${group.title.toLowerCase()}`} onChange={(event) => chooseUnit(group.key, event.currentTarget.value)}>
                      <option value="" selected={choice().units[group.key] === undefined}>as it was read</option>
                      <For each={group.units}>{([unit, name]) => <option value={unit} selected={choice().units[group.key] === unit}>{name}</option>}</For>
                    </select>
                  </td>
                </tr>
              )}
            </For>
          </tbody>
        </table>
      </div>
      <div class="fields">
        <label class="field">Order of the motors: the output of rotor 1, 2, …
          <input type="text" inputmode="numeric" size="18" placeholder="as it was read" value={order()} aria-invalid={order().trim() !== "" && !orderOf(order())} onInput={(event) => setOrder(event.currentTarget.value)} />
        </label>
        <Show when={source() === "canonical"}>
          <label class="field">Time stamps, × to seconds
            <input type="text" inputmode="decimal" size="8" placeholder="1" value={time()} onInput={(event) => setTime(event.currentTarget.value)} />
          </label>
        </Show>
      </div>
      <details>
        <summary>The same as a mapping (TOML, as in config/log-mappings), for columns and topics that have other names</summary>
        <textarea rows="8" spellcheck={false} aria-label="mapping" value={mapping()} onInput={(event) => setTyped(event.currentTarget.value || undefined)} />
      </details>
      <Problem sentence={problem() ?? builtIn.error() ?? props.twin.channels.error()} />
      <div class="row">
        <button type="submit" class="main" disabled={busy() || !mapping().trim()}>{busy() ? "Asking …" : "Read it again so"}</button>
        <Show when={props.refusal === undefined}>
          <button type="button" disabled={busy()} onClick={() => void again({ align: true })}>Take out the delays</button>
          <button type="button" disabled={busy()} onClick={() => void again({ vehicle: props.twin.vehicle() })}>Check the motors against {props.twin.vehicle()}</button>
        </Show>
        <Show when={/CRC|checksum|--damaged/.test(props.refusal ?? "")}>
          <button type="button" disabled={busy()} onClick={() => void again({ damaged: true })}>Take what can be read of it</button>
        </Show>
      </div>
    </form>
  );
}
