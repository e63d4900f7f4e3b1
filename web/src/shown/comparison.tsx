/** A comparison: the sentence, heat strips, one channel measured against model, worst moments, all numbers, what was assumed. */
import { type Accessor, For, type JSX, Show, createEffect, createMemo, createSignal } from "solid-js";
import type { Load } from "../api/load";
import { percent, short } from "../format";
import { type ChannelResult, type Comparison, type Conditions, type LogComparison, type ModelOnLog, type Series, channelStrip, channelTitle, comparisonSentence, partAt, timesWithin, worstChannel } from "../model/twin";
import type { FlightPicture } from "../model/flight";
import { Problem } from "../parts/bits";
import { Chart } from "../plots/chart";
import { Heat } from "../plots/heat";
import type { Lane } from "../plots/lanes";
import { type View, createView } from "../plots/view";
import { FlightLanes, FlightPlots } from "./flight";
import { ChannelSeries, RESIDUAL_PX } from "./series";

/** Length of a cell over time, s; as in the comparison. */
const BLOCK_S = 5;

/** The selected series. */
export interface Wanted {
  channel: string;
  log: number;
  range: readonly [number, number] | undefined;
}

/** The selected part of a comparison, and the source of its series: the address and the server, or a report. */
export interface Looks {
  logAt: () => number;
  chooseLog: (place: number) => void;
  channel: () => string | undefined;
  chooseChannel: (name: string) => void;
  series: (wanted: Accessor<Wanted>) => Load<Series>;
  /** The flight conditions of a log over time; `undefined`: not wanted. */
  conditions: (log: Accessor<number | undefined>) => Load<Conditions>;
  /** The flight of a log, if known: its parts, events, motors and vibration are shown on the time axis of the channels. */
  picture?: (log: number) => FlightPicture | undefined;
  /** Additional lanes on a log's time axis, by its name. */
  lanes?: (log: string) => readonly Lane[];
  /** The vehicle in 3-D, if a server knows its flight. */
  flight?: (view: View) => JSX.Element;
}

export function ComparisonView(props: { result: Comparison; looks: Looks }) {
  // When the condition that was clicked on is met.
  const [met, setMet] = createSignal<readonly (readonly [number, number])[]>([]);
  const view = createView(undefined, met);
  const log = () => props.result.logs[props.looks.logAt()] ?? props.result.logs[0];
  const [shown, setShown] = createSignal<string>();
  const model = () => log()?.models.find((one) => one.model === shown()) ?? log()?.models.at(-1);
  return (
    <>
      <For each={props.result.logs}>
        {(one, place) => (
          <div class={`say sentence ${one.models.at(-1)?.agrees ? "good" : "warn"}`}>
            <Show when={props.result.logs.length > 1}>
              <button type="button" class="plain" aria-pressed={log() === one} onClick={() => props.looks.chooseLog(place())}>{one.log.name}</button>
              {" "}
            </Show>
            {comparisonSentence(one)}
          </div>
        )}
      </For>
      <Show when={log() && model()}>
        <div class="row">
          <label class="row small">
            version shown
            <select onChange={(event) => setShown(event.currentTarget.value)}>
              <For each={log()?.models ?? []}>{(one) => <option value={one.model} selected={one.model === model()?.model}>{one.model}</option>}</For>
            </select>
          </label>
          <span class="small muted screen">A click on a cell opens the channel at that time, or where the condition is met.</span>
        </div>
        <Where log={log() as LogComparison} model={model() as ModelOnLog} looks={props.looks} view={view} setMet={setMet} />
      </Show>
    </>
  );
}

function Where(props: { log: LogComparison; model: ModelOnLog; looks: Looks; view: View; setMet: (times: readonly (readonly [number, number])[]) => void }) {
  const rows = () => props.model.channels.filter((one) => one.verdict !== "not-testable");
  const channel = () => {
    const wanted = props.looks.channel();
    if (rows().some((one) => one.channel === wanted)) return wanted as string;
    // Once all agree, the channel that failed before: there the improvement shows.
    return worstChannel(props.model.agrees ? (props.log.models[0] ?? props.model) : props.model);
  };
  const found = () => rows().find((one) => one.channel === channel());
  const picture = () => props.looks.picture?.(props.looks.logAt());
  const [cell, setCell] = createSignal<number>();
  const conditions = createMemo(() => {
    const all = new Map<string, { title: string; unit: string; most: number }>();
    for (const one of rows()) {
      for (const two of one.conditions) {
        const before = all.get(two.condition);
        all.set(two.condition, { title: two.title, unit: two.unit, most: Math.max(before?.most ?? 0, two.explained) });
      }
    }
    return [...all.entries()].sort((a, b) => b[1].most - a[1].most);
  });
  const [wanted, setWanted] = createSignal<string>();
  const condition = () => wanted() ?? found()?.conditions[0]?.condition ?? conditions()[0]?.[0];
  const title = () => conditions().find(([name]) => name === condition())?.[1];
  const bins = (place: number) => rows()[place]?.conditions.find((one) => one.condition === condition())?.bins ?? [];
  const curve = () => found()?.conditions.find((one) => one.condition === condition());
  const [clicked, setClicked] = createSignal<{ log: string; channel: string; condition: string; place: number }>();
  /** The cell of the strip over the condition that is looked at. */
  const chosen = () => {
    const one = clicked();
    return one && one.log === props.log.log.name && one.channel === channel() && one.condition === condition() ? one.place : undefined;
  };
  const part = createMemo(() => partAt(curve()?.bins ?? [], chosen() ?? -1));
  const over = props.looks.conditions(() => (part() ? props.looks.logAt() : undefined));
  const times = createMemo(() => {
    const [one, name, all] = [part(), condition(), over.data()];
    return one && name !== undefined && all && !over.loading() ? timesWithin(all, name, one) : [];
  });
  createEffect(() => props.setMet(times()));
  const met = () => times().reduce((sum, [from, to]) => sum + to - from, 0) / Math.max(1e-9, props.log.duration_s);
  const marks = () => {
    const [one, bins] = [part(), curve()?.bins ?? []];
    return one ? [{ from: Math.max(one.low, bins[0]?.at ?? one.bin.at), to: Math.min(one.high, bins.at(-1)?.at ?? one.bin.at), at: one.bin.at, label: short(one.bin.at), colour: "s4" }] : [];
  };
  const pickPart = (row: number, place: number) => {
    const [one, name] = [rows()[row], condition()];
    if (!one || name === undefined) return;
    setClicked({ log: props.log.log.name, channel: one.channel, condition: name, place });
    props.looks.chooseChannel(one.channel);
    // All of the flight: the condition may be met anywhere.
    props.view.setRange(undefined);
    setCell(undefined);
  };
  const pickTime = (row: number, place: number) => {
    const one = rows()[row];
    if (!one) return;
    setCell(place);
    setClicked(undefined);
    props.looks.chooseChannel(one.channel);
    props.view.setRange([Math.max(0, (place - 1) * BLOCK_S), Math.min(props.log.duration_s, (place + 2) * BLOCK_S)]);
    // The vehicle in 3-D stands at the cursor.
    props.view.setCursor(Math.min(props.log.duration_s, (place + 0.5) * BLOCK_S));
  };
  return (
    <>
      <Show when={rows().length === 0}>
        <p>
          No channel of the model has all that it needs. A flight can be compared once the log holds the motor outputs with the body rates (torque) or the accelerometer (force): what each missing column
          rules out is listed where the log is read.
        </p>
      </Show>
      <Show when={rows().length > 0}>
      <div class="two">
        <div class="stack">
          <h3>Channel over time</h3>
          <Heat
            title="chi²/N of each channel in blocks of 5 s"
            axis="time, s"
            rows={rows().map((one) => ({ name: channelStrip(one.channel), cells: one.strip, where: (place) => `${place * BLOCK_S} – ${(place + 1) * BLOCK_S} s` }))}
            tick={(place) => (place % 4 === 0 ? String(place * BLOCK_S) : "")}
            chosen={cell() === undefined ? undefined : { row: rows().findIndex((one) => one.channel === channel()), cell: cell() ?? 0 }}
            onPick={pickTime}
          />
        </div>
        <div class="stack">
          <div class="row">
            <h3>Channel over</h3>
            <select aria-label="flight condition" onChange={(event) => setWanted(event.currentTarget.value)}>
              <For each={conditions()}>{([name, one]) => <option value={name} selected={name === condition()}>{one.title}{one.unit ? `, ${one.unit}` : ""}</option>}</For>
            </select>
          </div>
          <Heat
            title={`chi²/N of each channel by ${title()?.title ?? "condition"}`}
            axis={title()?.unit || title()?.title || "value"}
            rows={rows().map((one, row) => ({ name: channelStrip(one.channel), cells: bins(row).map((bin) => bin.chi2), where: (place) => `${title()?.title} ${short(bins(row)[place]?.at)} ${title()?.unit}` }))}
            tick={(place) => {
              const longest = rows().map((_, row) => bins(row)).reduce((a, b) => (b.length > a.length ? b : a), []);
              return place % 2 === 0 ? short(longest[place]?.at, 2) : "";
            }}
            chosen={chosen() === undefined ? undefined : { row: rows().findIndex((one) => one.channel === channel()), cell: chosen() ?? 0 }}
            onPick={pickPart}
          />
          <div role="status">
            <Show when={part()}>
              {(one) => (
                <p class="small">
                  {channelTitle(channel())} at {title()?.title} {between(one().low, one().high)}{title()?.unit && title()?.unit !== "1" ? ` ${title()?.unit}` : ""}: mean residual {short(one().bin.mean)} {found()?.unit}, noise
                  alone ± {short(one().bin.band_95)}; chi²/N {short(one().bin.chi2)} over {one().bin.blocks} blocks.
                  <Show when={over.data()}> Shaded below: {times().length === 0 ? "no time" : `${percent(met(), 0)} of the flight`}.</Show>
                </p>
              )}
            </Show>
            <Problem sentence={over.error() && `When that is cannot be shown: ${over.error()}`} retry={over.reload} />
          </div>
        </div>
      </div>
      <label class="row small">
        channel
        <select onChange={(event) => props.looks.chooseChannel(event.currentTarget.value)}>
          <For each={rows()}>{(one) => <option value={one.channel} selected={one.channel === channel()}>{channelTitle(one.channel)}: {one.verdict}</option>}</For>
        </select>
      </label>
      </Show>
      <Show when={picture()}>{(flight) => <FlightLanes flight={flight()} view={props.view} more={props.looks.lanes?.(props.log.log.name) ?? []} />}</Show>
      <Show when={rows().length > 0}>
      <ChannelSeries looks={props.looks} channel={channel()} model={props.model.model} view={props.view}>
        <Show when={(curve()?.bins.length ?? 0) > 1}>
          <Chart
            title={`Mean residual of ${channel()} by ${curve()?.title ?? ""}`}
            unit={found()?.unit ?? ""}
            xLabel={curve()?.title ?? ""}
            xUnit={curve()?.unit ?? ""}
            x={curve()?.bins.map((bin) => bin.at) ?? []}
            bands={[{ label: "95 % of noise alone", low: curve()?.bins.map((bin) => -bin.band_95) ?? [], high: curve()?.bins.map((bin) => bin.band_95) ?? [], colour: "s3" }]}
            lines={[{ label: "residual", values: curve()?.bins.map((bin) => bin.mean) ?? [], colour: "s2", width: 2 }]}
            marks={marks()}
            height={RESIDUAL_PX}
          />
        </Show>
      </ChannelSeries>
      </Show>
      <Show when={picture()}>
        {(flight) => (
          <details class="whole" open>
            <summary>The flight itself: trajectory, motors, vibration</summary>
            <FlightPlots flight={flight()} view={props.view} />
          </details>
        )}
      </Show>
      <details class="whole">
        <summary>Worst moments, all channels in numbers, what was assumed</summary>
        <div class="scroll" tabindex="0" role="region" aria-label="Worst moments">
          <table class="small">
            <thead><tr><th scope="col">Time, s</th><th scope="col">Channel</th><th class="r" scope="col">mean error</th><th class="r" scope="col">deviations</th><th scope="col">conditions</th></tr></thead>
            <tbody>
              <For each={props.model.worst} fallback={<tr><td colspan="5" class="muted">none: no channel fails</td></tr>}>
                {(one) => (
                  <tr>
                    <td><button type="button" class="plain" onClick={() => { props.looks.chooseChannel(one.channel); props.view.setRange([Math.max(0, one.start_s - 2), one.end_s + 2]); props.view.setCursor(one.start_s); }}>{one.start_s.toFixed(1)} – {one.end_s.toFixed(1)}</button></td>
                    <td>{channelTitle(one.channel)}</td>
                    <td class="r">{short(one.error)} {one.unit}</td>
                    <td class="r">{one.deviations?.toFixed(0) ?? "–"}</td>
                    <td>{one.conditions.slice(0, 4).map(([name, value, unit]) => `${name} ${short(value)} ${unit}`).join(" · ")}</td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
        <div class="scroll" tabindex="0" role="region" aria-label="All channels">
          <table class="small">
            <thead><tr><th scope="col">Channel</th><th scope="col">says</th><th class="r" scope="col">error, 0.1 s means</th><th class="r" scope="col">noise alone</th><th scope="col">unit</th><th class="r" scope="col">chi²/N</th><th class="r" scope="col">slow</th><th class="r" scope="col">Ljung–Box p</th><th scope="col">depends most on</th><th scope="col">follows</th></tr></thead>
            <tbody>
              <For each={props.model.channels}>
                {(one) => (
                  <tr>
                    <td>{channelTitle(one.channel)}</td>
                    <td><span class={`tag ${one.verdict === "agrees" ? "good" : one.verdict === "fails" ? "bad" : ""}`}>{one.verdict}</span></td>
                    <td class="r">{short(one.smoothed_rms)}</td>
                    <td class="r">{short(one.smoothed_noise)}</td>
                    <td>{one.unit}</td>
                    <td class="r">{short(one.chi2)}</td>
                    <td class="r">{short(one.low_frequency)}</td>
                    <td class="r">{chance(one.ljung_box?.p_value)}</td>
                    <td>{one.conditions[0] && one.conditions[0].explained >= 0.01 ? `${one.conditions[0].title} (${(100 * one.conditions[0].explained).toFixed(0)} %)` : ""}</td>
                    <td>{followed(one)}</td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
        <p class="small muted">
          chi²/N: mean square of the whitened residual; slow: of its sums over 0.25 s; both are 1 for noise alone; a channel fails where chi²/N is above 1.25, or slow above 1.5 (kinematics: 4) and beyond chance. Ljung–Box: probability that white noise
          looks this coloured. Follows: correlation of the residual with an input 0.05 s to 0.5 s before it, where it is outside the 99 % band.
        </p>
        <Assumed log={props.log} model={props.model} />
      </details>
    </>
  );
}

/** `above 3`, `below 3`, `2 to 3`. */
const between = (low: number, high: number) =>
  Number.isFinite(low) ? (Number.isFinite(high) ? `${short(low)} to ${short(high)}` : `above ${short(low)}`) : Number.isFinite(high) ? `below ${short(high)}` : "of any size";

/** A probability; values below 0.001 are not distinguished. */
const chance = (value: number | null | undefined) => (typeof value === "number" && value < 0.001 ? "< 0.001" : short(value));

function followed(one: ChannelResult): string {
  const first = one.inputs[0];
  if (!first || typeof first.correlation !== "number" || typeof first.band_99 !== "number" || Math.abs(first.correlation) <= first.band_99) return "";
  return `${first.input} by ${short(first.lag_s)} s: ${short(first.correlation, 2)} (band ${short(first.band_99, 2)})`;
}

function Assumed(props: { log: LogComparison; model: ModelOnLog }) {
  const noise = () => props.log.noise;
  return (
    <ul class="small">
      <li>
        Noise, estimated from the log itself: position {short(noise().position_m)} m, velocity {short(noise().velocity_m_s)} m/s, attitude {short(noise().attitude_rad)} rad,
        rates {short(noise().rates_rad_s)} rad/s, accelerometer {short(noise().accel_m_s2)} m/s² (white disturbance included), voltage {short(noise().voltage_v)} V.
      </li>
      <li>Fitted to this log: lift error of the rotors {props.model.nuisances.rotor_bias_n.map((one) => (1e3 * one).toFixed(1)).join(" ")} mN, charge at the start {(100 * props.model.nuisances.charge_at_start).toFixed(1)} %<Show when={props.model.nuisances.wind_m_s}>{(wind) => <>, wind to north {wind()[0]?.toFixed(2)} and east {wind()[1]?.toFixed(2)} m/s</>}</Show>.</li>
      <li>Timing: a row is the state at its time, its duty holds to the next row; half a sample off would show as a latency.</li>
      <li>Left out (ends, ground): {props.log.excluded.length > 0 ? props.log.excluded.map((one) => `${one.start_s.toFixed(1)} – ${one.end_s.toFixed(1)} s`).join(", ") : "nothing"}.</li>
      <For each={props.log.notes}>{(one) => <li>{one}</li>}</For>
      <li>Not visible here: errors that look like white noise of a sensor, as the noise is estimated from the log; and what the flight did not excite, which a diagnosis lists with sizes.</li>
      <li>Content hash of the log: <code class="break">{props.log.log.hash || "made in memory"}</code></li>
    </ul>
  );
}

/** The model alone, from the measured state, with the logged commands. */
export function OpenLoop(props: { log: LogComparison }) {
  return (
    <Show when={(props.log.models[0]?.open_loop.length ?? 0) > 0}>
      <div class="scroll" tabindex="0" role="region" aria-label="Open loop">
        <table class="small">
          <caption>Open loop: the model alone, from the measured state, with the logged commands</caption>
          <thead>
            <tr>
              <th class="r" scope="col">after, s</th><th class="r" scope="col">starts</th>
              <For each={props.log.models}>{(one) => <><th class="r" scope="col">{one.model}: m</th><th class="r" scope="col">m/s</th><th class="r" scope="col">°</th></>}</For>
            </tr>
          </thead>
          <tbody>
            <For each={props.log.models[0]?.open_loop ?? []}>
              {(row, at) => (
                <tr>
                  <td class="r">{row.horizon_s}</td><td class="r">{row.starts}</td>
                  <For each={props.log.models}>
                    {(one) => {
                      const open = () => one.open_loop[at()];
                      const angle = () => open()?.attitude_rad;
                      return <><td class="r">{short(open()?.position_m)}</td><td class="r">{short(open()?.velocity_m_s)}</td><td class="r">{typeof angle() === "number" ? short(((angle() as number) * 180) / Math.PI) : "–"}</td></>;
                    }}
                  </For>
                </tr>
              )}
            </For>
          </tbody>
        </table>
      </div>
    </Show>
  );
}
