/** The influence of a catalogue effect on a flight, for chosen parameters: simulated by the server; nothing is computed here. */
import { For, Show, createEffect, createMemo, createSignal, on, onCleanup } from "solid-js";
import { type Schemas, address, ask } from "../api/client";
import { createLoad } from "../api/load";
import { short } from "../format";
import { channelTitle } from "../model/twin";
import { Problem } from "../parts/bits";
import { Chart } from "../plots/chart";

type Picture = Schemas["EffectPicture"];
export interface Sandboxed {
  id: string;
  name: string;
  per_rotor: boolean;
  parameters: readonly { name: string; symbol: string; unit: string; meaning: string; typical: number; plausible_low: number; plausible_high: number }[];
}

/** Delay after the last move of a slider. */
const SLIDING_MS = 250;
const STEPS = 100;

export function EffectSandbox(props: { effect: Sandboxed; vehicles: readonly string[] }) {
  const [open, setOpen] = createSignal(false);
  return (
    <details onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>What it does<span class="sr">: {props.effect.name}</span></summary>
      <Show when={open()}><Sandbox effect={props.effect} vehicles={props.vehicles} /></Show>
    </details>
  );
}

function Sandbox(props: { effect: Sandboxed; vehicles: readonly string[] }) {
  const [vehicle, setVehicle] = createSignal("f550");
  const [rotor, setRotor] = createSignal(1);
  const [values, setValues] = createSignal<Record<string, number>>(Object.fromEntries(props.effect.parameters.map((one) => [one.name, one.typical])));
  // The flight that shows it best is searched once per vehicle; then only this one is flown.
  const [flight, setFlight] = createSignal<string>();
  const wish = createMemo(() => ({ vehicle: vehicle(), rotor: rotor(), values: values() }));
  const [asked, setAsked] = createSignal(wish());
  createEffect(on(wish, (next) => {
    const timer = setTimeout(() => setAsked(next), SLIDING_MS);
    onCleanup(() => clearTimeout(timer));
  }, { defer: true }));
  const picture = createLoad(asked, (now, signal) =>
    ask<Picture>("GET", address("/api/v1/catalogue/{effect}/picture", {
      path: { effect: props.effect.id },
      query: {
        vehicle: now.vehicle, flight: flight(), rotor: props.effect.per_rotor ? now.rotor : undefined,
        parameters: Object.entries(now.values).map(([name, value]) => `${name}:${value}`).join(","),
      },
    }), undefined, { signal }),
  );
  const [last, setLast] = createSignal<Picture>();
  createEffect(() => {
    const found = picture.data();
    if (!found) return;
    setLast(found);
    if (found.channels.length > 0) setFlight(found.flight);
  });
  return (
    <div class="stack sandbox">
      <div class="fields">
        <label class="field">Vehicle
          <select value={vehicle()} onChange={(event) => { setFlight(undefined); setVehicle(event.currentTarget.value); }}>
            <For each={props.vehicles}>{(name) => <option value={name} selected={name === vehicle()}>{name}</option>}</For>
          </select>
        </label>
        <Show when={props.effect.per_rotor}>
          <label class="field">Rotor<input type="number" min="1" max="12" value={rotor()} onInput={(event) => setRotor(Math.max(1, Math.round(Number(event.currentTarget.value)) || 1))} /></label>
        </Show>
        <For each={props.effect.parameters}>
          {(one) => (
            <label class="field grow">
              <span>{one.symbol} <code class="small">{one.name}</code> = <span class="num">{short(values()[one.name])} {one.unit === "1" ? "" : one.unit}</span></span>
              <input
                type="range" min={one.plausible_low} max={one.plausible_high} step={(one.plausible_high - one.plausible_low) / STEPS || "any"} value={values()[one.name]}
                onInput={(event) => { const value = Number(event.currentTarget.value); setValues((before) => ({ ...before, [one.name]: value })); }}
              />
            </label>
          )}
        </For>
      </div>
      <Problem sentence={picture.error()} retry={picture.reload} />
      <p class="small muted" role="status">{picture.loading() ? "Flying it …" : ""}</p>
      <Show when={last()}>{(found) => <Pictured picture={found()} name={props.effect.name} />}</Show>
    </div>
  );
}

function Pictured(props: { picture: Picture; name: string }) {
  const it = () => props.picture;
  const [channel, setChannel] = createSignal<string>();
  const shown = () => it().channels.find((one) => one.channel === channel()) ?? it().channels[0];
  const over = () => shown()?.conditions[0];
  const words = () => (it().random ? "what one flight with it leaves" : "what it does");
  return (
    <Show when={shown()} fallback={<p class="say">No manoeuvre of the simulator shows anything of it at this size.</p>}>
      {(one) => (
        <>
          <label class="row small">
            channel
            <select onChange={(event) => setChannel(event.currentTarget.value)}>
              <For each={it().channels}>{(other) => <option value={other.channel} selected={other.channel === one().channel}>{channelTitle(other.channel)}: {short(other.rms / other.noise)} × noise</option>}</For>
            </select>
          </label>
          <Show when={over()}>
            {(condition) => (
              <Chart
                title={`${channelTitle(one().channel)}: ${words()} over ${condition().title}`} unit={one().unit} xLabel={condition().title} xUnit={condition().unit}
                x={condition().at} lines={[{ label: props.name, values: condition().does, colour: "s2", width: 2 }]}
                bands={[{ label: "noise of a mean over 0.25 s", low: condition().at.map(() => -1.96 * one().noise), high: condition().at.map(() => 1.96 * one().noise), colour: "s3" }]}
                height={200}
              />
            )}
          </Show>
          <Chart title={`${channelTitle(one().channel)}: ${words()} over time`} unit={one().unit} x={one().time_s} lines={[{ label: props.name, values: one().does, colour: "s1" }]} height={140} />
          <p class="small muted">
            Simulated: {it().description}, {short(it().duration_s)} s, the manoeuvre that shows it best.{" "}
            <Show when={it().together_with.length > 0}>Together with {it().together_with.join(", ")}, without which it does nothing.</Show>
          </p>
        </>
      )}
    </Show>
  );
}
