/** A vehicle that was identified from flights: the plain answer, where its rotors are, each value with interval and source, what of the flights
 * was used, and how well each half of a flight is predicted by what the other half gave. Asks no server. */
import { For, type JSX, Show } from "solid-js";
import { count, short } from "../format";
import { type Estimate, type Identification, adviceOf, adviceText, answerOf, bandWords, channelWords, predicted, groupsOf, knownHow, rotorsOf, sourceOf, usedLane } from "../model/identify";
import { Panel } from "../parts/bits";
import { VehiclePicture } from "../parts/vehicle-picture";
import { type OverTime, OverTimeView } from "./over-time";

/** Contents of the report of `vehicle from-log`. */
export type IdentifiedReport = Identification & { name: string; over_time: OverTime | null };

export function IdentifiedReportView(props: { report: IdentifiedReport }) {
  const it = () => props.report.identified;
  const rotors = () => rotorsOf(props.report.vehicle);
  return (
    <>
      <Panel title={`${props.report.name}, from ${it().logs.join(", ")}`} note={`defaults of the class ${it().class.name}`}>
        <div class="stack">
          <div class={`say sentence ${answerOf(it().values).kind}`} role="status"><strong>{answerOf(it().values).head}</strong> {answerOf(it().values).rest}</div>
          <div class="side">
            <div class="stack">
              <p>
                {count(it().outputs.length, "rotor")} on outputs {it().outputs.join(", ")} of the autopilot; where they are and how they turn: <strong>{it().airframe.name}</strong>,{" "}
                {knownHow(it().airframe)}.
              </p>
              <Advice values={it().values} />
            </div>
            <Show when={rotors()}>{(list) => <VehiclePicture geometry={{ name: props.report.name, rotors: list() }} />}</Show>
          </div>
        </div>
      </Panel>
      <Panel title="What is known, and from where" note="intervals are 95 %: another flight may tell any value within">
        <Values values={it().values} />
      </Panel>
      <Show when={props.report.over_time}>{(data) => <OverTimeView data={data()} lanes={(log) => [usedLane(it(), log)]} />}</Show>
      <Panel title="How well it predicts what no fit has seen">
        <Show when={props.report.held_out.length > 0} fallback={<p>Not asked for: <code>--held-out</code> fits each half of each flight and scores it on the other.</p>}>
          <HeldOut scores={props.report.held_out} />
        </Show>
      </Panel>
      <Show when={it().notes.length > 0}><Panel title="Found on the way"><ul class="small"><For each={it().notes}>{(one) => <li>{one}</li>}</For></ul></Panel></Show>
      <Panel title="The documents">
        <details>
          <summary>Vehicle and blades (TOML)</summary>
          <pre tabindex="0" aria-label="vehicle document">{props.report.vehicle}</pre>
          <pre tabindex="0" aria-label="blades document">{props.report.blades}</pre>
        </details>
      </Panel>
    </>
  );
}

/** Recommendations for improvement, each once. */
export function Advice(props: { values: readonly Estimate[] }) {
  return (
    <Show when={adviceOf(props.values).length > 0}>
      <div>
        <h4>What would make less of it a guess</h4>
        <ul class="small"><For each={adviceOf(props.values)}>{(one) => <li>{one.better}: {one.names.join(", ")}</li>}</For></ul>
      </div>
    </Show>
  );
}

/** Every value with interval, source, how it was found and what would make it better; together by where they come from. */
function Values(props: { values: readonly Estimate[] }) {
  return (
    <div class="stack">
      <For each={groupsOf(props.values)}>
        {(group) => (
          <details class="whole" open={group.open}>
            <summary>{group.title} ({group.values.length})</summary>
            <ValueTable values={group.values} label={group.title} />
          </details>
        )}
      </For>
    </div>
  );
}

export function ValueTable(props: { values: readonly Estimate[]; label: string }): JSX.Element {
  return (
    <div class="scroll" tabindex="0" role="region" aria-label={props.label}>
      <table class="small values">
        <thead>
          <tr><th scope="col">Quantity</th><th class="r" scope="col">value</th><th class="r" scope="col">95 % interval</th><th scope="col">unit</th><th scope="col">from</th><th scope="col">how</th><th scope="col">what would make it better</th></tr>
        </thead>
        <tbody>
          <For each={props.values}>
            {(one) => (
              <tr>
                <th scope="row">{one.name}</th>
                <td class="r">{short(one.value, 4)}</td>
                <td class="r">{one.low < one.high ? `${short(one.low, 4)} to ${short(one.high, 4)}` : "–"}</td>
                <td>{one.unit || "1"}</td>
                <td><span class={`tag ${sourceOf(one.source).kind}`}>{sourceOf(one.source).words}</span></td>
                <td>{one.how}</td>
                <td>{one.source === "entered" ? "" : adviceText(one.better)}</td>
              </tr>
            )}
          </For>
        </tbody>
      </table>
    </div>
  );
}

/** R² of each half, predicted from the other half. */
export function HeldOut(props: { scores: Identification["held_out"] }) {
  return (
    <For each={props.scores}>
      {(log) => (
        <>
        <p class="small muted">
          {log.log}, {short(log.seconds)} s in the air. Each half is predicted with what the other half gave: 100 % would be every motion predicted, 0 % no better than the mean. Gains of
          the second half over the first: roll {short(log.gain_ratio[0])}, pitch {short(log.gain_ratio[1])} (1: both tell the same vehicle).
        </p>
        <div class="scroll" tabindex="0" role="region" aria-label={`Scores of the halves of ${log.log}`}>
          <table class="small">
            <thead><tr><th scope="col">What is predicted</th><th scope="col">how fast</th><th class="r" scope="col">by the class default</th><th class="r" scope="col">by this vehicle</th></tr></thead>
            <tbody>
              <For each={log.scores}>
                {(one) => (
                  <tr>
                    <td>{channelWords(one.channel)}</td>
                    <td>{bandWords(one.band)}</td>
                    <td class="r">{predicted(one.class_default)}</td>
                    <td class="r"><strong>{predicted(one.calibrated)}</strong> <Show when={one.calibrated < one.class_default - 0.005}><span class="tag warn">worse</span></Show></td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
        </>
      )}
    </For>
  );
}
