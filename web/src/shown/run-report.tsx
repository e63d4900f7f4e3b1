/** A whole run, as its report shows it: summary, the paper's figures, residuals in numbers. */
import { For, Show } from "solid-js";
import { type Samples, type Summary, faultIntervals } from "../model/run";
import { Figures, Panel } from "../parts/bits";
import { Chart } from "../plots/chart";
import type { Values } from "../plots/series";
import { type View, createView } from "../plots/view";
import { short } from "../format";
import { RunPlots } from "./run-plots";
import { RunSummary } from "./run-summary";

/** Quantiles of the residual of one rotor, component by component, against those of a normal distribution. */
interface NormalPlot {
  rotor: number;
  /** Standard normal quantiles. */
  z: number[];
  panels: { title: string; lines: { quantiles: Values; reference: [number, number] }[] }[];
}
export interface RunReport {
  summary: Summary;
  /** As from the server: thinned to minimum and maximum samples. None: no step was recorded. */
  telemetry: { data: Record<string, Values>; units: Record<string, string> } | null;
  normal: NormalPlot | null;
}
const COMPONENTS = ["arm", "lever", "yaw"] as const;
const COLOURS = ["s1", "s2", "s4"] as const;

export function RunReportView(props: { report: RunReport }) {
  const view = createView(undefined, () => faultIntervals(props.report.summary));
  const it = () => props.report.summary;
  const samples = (): Samples | undefined => {
    const found = props.report.telemetry;
    return found ? { time: (found.data["time_s"] ?? []) as number[], data: found.data, units: found.units } : undefined;
  };
  const facts = () => [it().scenario.vehicle, it().rotor_count ? `${it().rotor_count} rotors` : "", it().seed === undefined ? "" : `seed ${it().seed}`, it().link, it().pace, it().started_at].filter(Boolean);
  return (
    <>
      <p class="muted"><span class={`tag ${it().status === "done" ? "good" : it().status === "failed" ? "bad" : "warn"}`}>{it().status}</span> {facts().join(" · ")}</p>
      <Show when={it().status === "canceled"}><div class="say warn">This run was stopped after {it().steps.toLocaleString("en")} steps; what follows covers these.</div></Show>
      <Show when={it().status === "failed" && !it().failure}><div class="say bad">This run failed. The reason was not recorded.</div></Show>
      <RunSummary summary={it()} />
      <Show when={samples()} fallback={<div class="say warn">No step was recorded, so there is nothing to draw.</div>}>
        {(found) => (
          <>
            <p class="small muted screen">Drag over a plot to zoom: all plots over time follow. Double-click or Escape: all.</p>
            <p class="small muted">Shaded: a fault is in force.</p>
            <Tracking summary={it()} samples={found()} view={view} />
            <RunPlots samples={found()} view={view} all own={it().own_detectors} />
          </>
        )}
      </Show>
      <Show when={props.report.normal}>{(normal) => <Normal plot={normal()} />}</Show>
      <ResidualTable summary={it()} />
      <Panel title="How it was made">
        <dl class="facts">
          <For each={[["run", it().run], ["run hash", it().run_hash], ["vehicle model", it().model_hash], ["scenario file", it().scenario.path], ["program", it().program_version]] as const}>
            {([name, value]) => <Show when={value}><dt>{name}</dt><dd class="mono">{value}</dd></Show>}
          </For>
        </dl>
        <p class="small muted">
          In the same folder: summary.json<Show when={it().steps > 0}>, telemetry.parquet (every column of every step, for pandas, Polars, DuckDB, MATLAB), run.mcap (for Foxglove and
          Lichtblick), figures/ (SVG)</Show>. Equal scenario, seed and program give an equal run hash, over every link and at every pace.
        </p>
      </Panel>
    </>
  );
}

/** Position and attitude with their references: the paper's Figs. 9 and 10. */
function Tracking(props: { summary: Summary; samples: Samples; view: View }) {
  const values = (name: string, by = 1): Values => (props.samples.data[name] ?? []).map((value) => (value === null ? null : value * by));
  const common = () => ({ x: props.samples.time, view: props.view, height: 140 });
  const degrees = 180 / Math.PI;
  const rms = () => props.summary.tracking;
  const angle = (value: number | null | undefined) => (typeof value === "number" ? `${short(value * degrees)}°` : "–");
  const pair = (asked: string, is: string, by = 1) => [
    { label: "asked for", values: values(asked, by), colour: "s2", dash: [5, 3] },
    { label: "true", values: values(is, by), colour: "s1" },
  ];
  return (
    <div class="two">
      <Panel title="Position" note="the paper's Fig. 9">
        <Figures items={["north", "east", "down"].map((name, k) => [`rms, ${name}`, `${short(rms()?.position_rms_ned_m?.[k])} m`] as const)} />
        <Chart title="North" unit="m" lines={pair("reference_north_m", "true_position_north_m")} {...common()} />
        <Chart title="East" unit="m" lines={pair("reference_east_m", "true_position_east_m")} {...common()} />
        <Chart title="Down" unit="m" lines={pair("reference_down_m", "true_position_down_m")} {...common()} />
      </Panel>
      <Panel title="Attitude" note="the paper's Fig. 10; yaw follows its reference, roll and pitch what the position loop commands">
        <Figures items={["roll", "pitch", "yaw"].map((name, k) => [`rms, ${name}`, angle(rms()?.attitude_rms_rad?.[k])] as const)} />
        <Chart title="Roll" unit="°" lines={pair("roll_setpoint_rad", "true_roll_rad", degrees)} {...common()} />
        <Chart title="Pitch" unit="°" lines={pair("pitch_setpoint_rad", "true_pitch_rad", degrees)} {...common()} />
        <Chart title="Yaw" unit="°" lines={pair("reference_yaw_rad", "true_yaw_rad", degrees)} {...common()} />
      </Panel>
    </div>
  );
}

function Normal(props: { plot: NormalPlot }) {
  return (
    <Panel title={`Normal plot of residual ${props.plot.rotor}`} note="the paper's Fig. 13; straight: normal; a step up or down: a shift of the mean; dashed: through the quartiles">
      <div class="two">
        <For each={props.plot.panels}>
          {(panel) => (
            <Chart
              title={panel.title} unit="N·m·s" xLabel="quantile of the standard normal distribution" xUnit="" x={props.plot.z} height={250}
              lines={[
                ...panel.lines.map((line, k) => ({ label: COMPONENTS[k] ?? "", values: line.quantiles, colour: COLOURS[k] ?? "s8", points: true })),
                ...panel.lines.map((line, k) => ({ label: `${COMPONENTS[k]}, normal`, values: props.plot.z.map((z) => line.reference[0] + z * line.reference[1]), colour: COLOURS[k] ?? "s8", dash: [5, 4], width: 1 })),
              ]}
            />
          )}
        </For>
      </div>
    </Panel>
  );
}

function ResidualTable(props: { summary: Summary }) {
  const rotors = () => Array.from({ length: props.summary.rotor_count }, (_, k) => k);
  const cell = (mean: number | null | undefined, deviation: number | null | undefined) => (typeof mean === "number" && typeof deviation === "number" ? `${(1e3 * mean).toFixed(1)} (${(1e3 * deviation).toFixed(1)})` : "–");
  return (
    <Show when={(props.summary.intervals ?? []).some((one) => one.residual_means_nms.length > 0)}>
      <Panel title="Residuals in numbers" note="mean (standard deviation) in mN·m·s; by design, residual i does not see a fault of rotor i">
        <div class="scroll" tabindex="0" role="region" aria-label="Residuals in numbers">
          <table class="small">
            <thead><tr><th scope="col">Interval, s</th><th scope="col">Truth</th><th scope="col">component</th><For each={rotors()}>{(k) => <th class="r" scope="col">residual {k + 1}</th>}</For></tr></thead>
            <tbody>
              <For each={props.summary.intervals}>
                {(one) => (
                  <For each={COMPONENTS}>
                    {(name, c) => (
                      <tr>
                        <td class="num">{c() === 0 ? `${short(one.residuals_from_s ?? one.start_s, 4)} – ${short(one.end_s, 4)}` : ""}</td>
                        <td>{c() === 0 ? one.description : ""}</td><td>{name}</td>
                        <For each={rotors()}>{(k) => <td class="r">{cell(one.residual_means_nms?.[k]?.[c()], one.residual_deviations_nms?.[k]?.[c()])}</td>}</For>
                      </tr>
                    )}
                  </For>
                )}
              </For>
            </tbody>
          </table>
        </div>
      </Panel>
    </Show>
  );
}
