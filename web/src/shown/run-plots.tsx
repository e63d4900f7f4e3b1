/** Plots of a run. */
import { For, Show, createMemo, createSignal } from "solid-js";
import type { OwnDetector, Samples } from "../model/run";
import { Panel } from "../parts/bits";
import { Chart, type Line } from "../plots/chart";
import { Lanes } from "../plots/lanes";
import { type Values, movingMean, stretches } from "../plots/series";
import type { View } from "../plots/view";
import { seriesColour } from "../theme";

/** Points of a residual's mean, out of about 1600. */
const MEAN_POINTS = 31;
const COMPONENTS = ["arm", "lever", "yaw"] as const;

/** `all`: every component of the residuals at once, for printing; motion is then shown elsewhere. `own`: detectors of the user's own. */
export function RunPlots(props: { samples: Samples; view: View; all?: boolean; own?: OwnDetector[] | undefined }) {
  const [component, setComponent] = createSignal<(typeof COMPONENTS)[number]>("arm");
  const values = (name: string): Values => props.samples.data[name] ?? [];
  const scaled = (name: string, by: number): Values => values(name).map((value) => (value === null ? null : value * by));
  const rotors = createMemo(() => {
    let count = 0;
    while (`duty_${count + 1}` in props.samples.data) count += 1;
    return Array.from({ length: count }, (_, k) => k + 1);
  });
  const perRotor = (name: (rotor: number) => string, by = 1): Line[] =>
    rotors().map((rotor) => ({ label: `rotor ${rotor}`, values: by === 1 ? values(name(rotor)) : scaled(name(rotor), by), colour: seriesColour(rotor - 1), ...(rotor > 8 ? { dash: [6, 3] } : {}) }));
  const lanes = createMemo(() =>
    [
      ["truth", "fault_label"],
      ["sequential", "verdict_sequential"],
      ["T-test", "verdict_t_test"],
      ["network", "verdict_network"],
      ...(props.own ?? []).map((one) => [one.name, one.column]),
    ].map(([name, channel]) => ({
      name: name ?? "",
      stretches: stretches(props.samples.time, values(channel ?? "")),
      ...(name === "truth" ? { words: (code: number) => (code === 0 ? "no fault" : code === -1 ? "several rotors" : `rotor ${code}`) } : {}),
    })),
  );
  // The samples of six rotors overlap; their means do not.
  const residuals = (component: string): Line[] => {
    const samples = perRotor((rotor) => `residual_${rotor}_${component}_nms`);
    return [...samples.map((line) => ({ ...line, faint: true })), ...samples.map((line) => ({ ...line, values: movingMean(line.values, MEAN_POINTS), width: 1.8 }))];
  };
  // If no rotor is named there is no loss to show.
  const named = (name: string, from = 1): Values => scaled(name, 100).map((value, k) => ((values("verdict_sequential")[k] ?? 0) >= from ? value : null));
  const common = () => ({ x: props.samples.time, view: props.view });

  return (
    <>
      <Panel title="Verdicts over the true faults" actions={<Zoom view={props.view} />}>
        <Lanes title="Verdicts over the true faults" lanes={lanes()} start={props.samples.time[0] ?? 0} end={props.samples.time.at(-1) ?? 1} view={props.view} />
        <div class="two">
          <Chart title="Probability of the sequential verdict" unit="%" lines={[{ label: "probability", values: scaled("sequential_probability", 100), colour: "s1", step: true }]} {...common()} height={150} />
          <Show when={named("thrust_loss_share").some((value) => typeof value === "number")} fallback={<p class="small muted">No rotor is named in this time, so that no loss of thrust is estimated.</p>}>
            <Chart
              title="Estimated loss of thrust"
              unit="% of nominal"
              bands={[{ label: "95 % interval", low: named("thrust_loss_share_low"), high: named("thrust_loss_share_high"), colour: "s2" }]}
              lines={[
                { label: "first rotor named", values: named("thrust_loss_share"), colour: "s2", step: true },
                { label: "second", values: named("second_thrust_loss_share", 100), colour: "s4", step: true },
              ]}
              {...common()}
              height={150}
            />
          </Show>
        </div>
      </Panel>
      <div class="two" classList={{ tall: props.all ?? false }}>
        <Panel
          title="Residuals"
          note="thick: mean"
          actions={
            <Show when={!props.all}>
              <span class="row" role="group" aria-label="component of the residual">
                <For each={COMPONENTS}>{(one) => <button type="button" aria-pressed={component() === one} onClick={() => setComponent(one)}>{one}</button>}</For>
              </span>
            </Show>
          }
        >
          <For each={props.all ? COMPONENTS : [component()]}>
            {(one) => <Chart title={`Residual r, ${one}`} unit="N·m·s" lines={residuals(one)} {...common()} height={240} />}
          </For>
        </Panel>
        <Panel title="Duties">
          <Chart title="Duty cycle" unit="%" lines={perRotor((rotor) => `duty_${rotor}`, 100)} {...common()} height={240} />
        </Panel>
        <Panel title="Battery">
          <Chart
            title="Voltage"
            unit="V"
            lines={[
              { label: "measured", values: values("battery_voltage_v"), colour: "s1" },
              { label: "open circuit", values: values("true_open_circuit_voltage_v"), colour: "s7", dash: [5, 3] },
            ]}
            {...common()}
            height={150}
          />
          <Chart title="State of charge" unit="%" lines={[{ label: "charge", values: scaled("true_state_of_charge", 100), colour: "s3" }]} {...common()} height={120} />
        </Panel>
        <Show when={!props.all}>
          <Panel title="Motion">
            <Chart
              title="Height"
              unit="m"
              lines={[
                { label: "true", values: scaled("true_position_down_m", -1), colour: "s1" },
                { label: "reference", values: scaled("reference_down_m", -1), colour: "s2", dash: [5, 3] },
              ]}
              {...common()}
              height={130}
            />
            <Chart
              title="Attitude"
              unit="°"
              lines={[
                { label: "roll", values: scaled("true_roll_rad", 180 / Math.PI), colour: "s1" },
                { label: "pitch", values: scaled("true_pitch_rad", 180 / Math.PI), colour: "s2" },
                { label: "yaw", values: scaled("true_yaw_rad", 180 / Math.PI), colour: "s3" },
              ]}
              {...common()}
              height={140}
            />
          </Panel>
        </Show>
      </div>
    </>
  );
}

/** The interval shown, and a button to show everything. */
export function Zoom(props: { view: View }) {
  return (
    <Show when={props.view.range()} fallback={<span class="small muted">drag over a plot to zoom</span>}>
      {(range) => (
        <button type="button" onClick={() => props.view.setRange(undefined)}>
          {range()[0].toFixed(2)} – {range()[1].toFixed(2)} s: show all
        </button>
      )}
    </Show>
  );
}
