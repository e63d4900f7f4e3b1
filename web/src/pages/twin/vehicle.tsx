/** Step 3: the vehicle of the flight, drawn, and its model with versions. */
import { For, Show, createEffect, createSignal, on } from "solid-js";
import { ask, get } from "../../api/client";
import { createLoad } from "../../api/load";
import { percent, short } from "../../format";
import { Figures, Problem } from "../../parts/bits";
import { VehiclePicture } from "../../parts/vehicle-picture";
import type { FullGeometry } from "../../replay/motion";
import { Known } from "../../shown/known";
import { FromLog } from "./from-log";
import { Step } from "./step";
import type { Twin } from "./state";

export function Vehicle(props: { twin: Twin }) {
  const names = createLoad(() => true, async (_, signal) => {
    const [vehicles, models] = await Promise.all([get("/api/v1/vehicles", { signal }), get("/api/v1/models", { signal })]);
    return { vehicles: vehicles.items, models: models.items };
  });
  const geometry = createLoad(() => props.twin.vehicle(), (name, signal) => ask<FullGeometry>("GET", `/api/v1/vehicles/${encodeURIComponent(name)}/geometry`, undefined, { signal }));
  const models = () => (names.data()?.models ?? []).filter((name) => !names.data()?.vehicles.includes(name));
  const [opened, setOpen] = createSignal<boolean>();
  const [known, setKnown] = createSignal(false);
  const open = () => opened() ?? (props.twin.identification() !== undefined || props.twin.unfit() !== undefined);
  // Asked for from another step: the form opens where the eyes are led to.
  createEffect(on(() => props.twin.fromLog(), (asked) => {
    if (asked === 0) return;
    setOpen(true);
    queueMicrotask(() => {
      const form = document.querySelector("#from-log form");
      form?.scrollIntoView({ block: "start" });
      form?.querySelector("input")?.focus({ preventScroll: true });
    });
  }));
  const flight = () => (props.twin.logs().length > 0 ? "log" : "run");
  const pick = (value: string) => {
    if (value.startsWith("model:")) props.twin.chooseModel(value.slice(6));
    else props.twin.chooseVehicle(value);
  };
  return (
    <Step
      number={3}
      title="Which vehicle"
      later="one of the library, or a new one from your log, its mass and its size"
      state={!props.twin.flightsReady() ? "waiting" : props.twin.history.error() || props.twin.unfit() !== undefined ? "problem" : "done"}
      note={props.twin.model() ? `model ${props.twin.model()}, ${props.twin.line().at(-1)?.label ?? "…"}` : undefined}
    >
      <Show when={props.twin.unfit()}>
        {(count) => (
          <div class="say warn sentence" role="status">
            The {flight()} is of a vehicle with {count()} rotors. Choose one of the library, or make it from this {flight()}: its mass and its size are enough.
          </div>
        )}
      </Show>
      <Show when={props.twin.assumed()}>
        <Show
          when={props.twin.rotorsOfFlight() !== 0}
          fallback={<div class="say">The log holds no motor outputs: it does not say which vehicle flew, and none can be made from it. <strong>{props.twin.vehicle()}</strong> is taken until you choose.</div>}
        >
          <div class="say row">
            <span>The log does not say which vehicle flew: <strong>{props.twin.vehicle()}</strong> is taken until you choose. Is yours another one? Its mass and its size are enough.</span>
            <button type="button" onClick={() => props.twin.openFromLog()}>Make it from this log</button>
          </div>
        </Show>
      </Show>
      <Problem sentence={props.twin.history.error()} retry={props.twin.history.reload} />
      <Problem sentence={names.error()} retry={names.reload} />
      <div class="side">
        <div class="stack">
          <label class="field">
            Vehicle, whose model begins at version 0; or a model that exists
            <select onChange={(event) => pick(event.currentTarget.value)}>
              <Show when={props.twin.unfit() !== undefined}><option value="" disabled selected>choose …</option></Show>
              <optgroup label="Vehicles: a new model begins at version 0">
                <For each={names.data()?.vehicles ?? [props.twin.vehicle()]}>
                  {(name) => <option value={name} selected={props.twin.unfit() === undefined && name === props.twin.vehicle()}>{name}</option>}
                </For>
              </optgroup>
              <Show when={models().length > 0}>
                <optgroup label="Models">
                  <For each={models()}>{(name) => <option value={`model:${name}`} selected={name === props.twin.model() && !name.startsWith(`${props.twin.vehicle()}-`)}>{name}</option>}</For>
                </optgroup>
              </Show>
            </select>
          </label>
          <Show when={props.twin.unfit() === undefined && geometry.data()}>
            {(found) => (
              <Figures
                items={[
                  ["vehicle", found().name],
                  ["mass", `${short(found().mass_kg)} kg`],
                  ["arm", `${short(found().arm_m)} m`],
                  ["rotors", String(found().rotors.length)],
                  ["hover thrust", `${short(found().hover?.thrust_n)} N`],
                  ["hover duty", percent(found().hover?.duty[0], 0)],
                ]}
              />
            )}
          </Show>
          <Show when={props.twin.unfit() === undefined}>
            <p class="small muted">
              The values are those of the vehicle's document (<a href={`/library?kind=vehicles&name=${encodeURIComponent(props.twin.vehicle())}`}>read it</a>).
              Where the {flight()} contradicts them, steps 4 and 5 say so.
            </p>
            <details onToggle={(event) => setKnown(event.currentTarget.open)}>
              <summary>How well its values are known, with 95 % intervals</summary>
              <Show when={known()}><Known vehicle={props.twin.vehicle()} /></Show>
            </details>
          </Show>
          <div class="row">
            <button type="button" aria-expanded={open()} aria-controls="from-log" onClick={() => setOpen(!open())}>A new one from this {flight()}</button>
            <span class="small muted">No fitting vehicle? Mass and size are enough.</span>
          </div>
        </div>
        <div>
          <Problem sentence={geometry.error() && `No picture of the vehicle: ${geometry.error()}`} />
          <Show when={props.twin.unfit() === undefined && geometry.data()}>{(found) => <VehiclePicture geometry={found()} />}</Show>
        </div>
      </div>
      <div id="from-log">
        <Show when={open()}><FromLog twin={props.twin} taken={names.data()?.vehicles ?? []} onKept={names.reload} /></Show>
      </div>
    </Step>
  );
}
