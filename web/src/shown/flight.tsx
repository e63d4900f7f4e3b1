/** A flight on one time axis: parts and events, position, motor commands, and vibration. Needs no server. */
import { For, Show } from "solid-js";
import { type FlightPicture, eventLanes, flightSentence, outputLines, partLane, rotorSpeedWords } from "../model/flight";
import { Chart, type Line } from "../plots/chart";
import { type Lane, Lanes } from "../plots/lanes";
import { Track } from "../plots/track";
import type { View } from "../plots/view";
import { seriesColour } from "../theme";

/** Parts and events, with the caller's lanes above or below. */
export function FlightLanes(props: { flight: FlightPicture; view: View; more?: readonly Lane[] }) {
  return (
    <div class="stack">
      <p class="small">
        {flightSentence(props.flight)}
        <Show when={props.flight.clock_start_s}>{(start) => <span class="muted"> 0 s here is {start().toFixed(2)} s of the log's own clock.</span>}</Show>
      </p>
      <Lanes
        title={`Parts and events of ${props.flight.name}`} start={props.flight.start_s} end={props.flight.end_s} view={props.view}
        lanes={[partLane(props.flight.parts.parts), ...eventLanes(props.flight), ...(props.more ?? [])]}
      />
    </div>
  );
}

/** Trajectory, motors, battery, vibration. */
export function FlightPlots(props: { flight: FlightPicture; view: View }) {
  const it = () => props.flight;
  const common = () => ({ x: it().time_s, view: props.view });
  return (
    <div class="stack">
      <div class="side">
        <div class="stack">
          <Show when={it().outputs.length > 0}><Outputs flight={it()} view={props.view} /></Show>
          <Show when={it().height_m}>{(height) => <Chart title="Height" unit="m" lines={[{ label: "height", values: height(), colour: "s1" }]} {...common()} height={130} />}</Show>
        </div>
        <div class="stack">
          <Show when={it().track} fallback={<p class="small muted">The log has no position: where the vehicle went is not known.</p>}>
            {(track) => <Track title="Trajectory from above" time={it().time_s} north={track().north_m} east={track().east_m} view={props.view} />}
          </Show>
        </div>
      </div>
      <div class="two">
        <Show when={it().attitude_deg}>
          {(angles) => (
            <Chart
              title="Attitude" unit="°" {...common()} height={150}
              lines={(["roll", "pitch", "yaw"] as const).map((label, axis) => ({ label, values: angles()[axis] ?? [], colour: seriesColour(axis) }))}
            />
          )}
        </Show>
        <Show when={it().voltage_v}>{(volts) => <Chart title="Battery voltage" unit="V" lines={[{ label: "measured", values: volts(), colour: "s1" }]} {...common()} height={150} />}</Show>
      </div>
      <Show when={it().vibration} fallback={<p class="small muted">No spectrum of the vibration: the log has neither accelerometer nor gyroscope, or no second of flight without gaps.</p>}>
        {(found) => <Spectra vibration={found()} />}
      </Show>
    </div>
  );
}

function Outputs(props: { flight: FlightPicture; view: View }) {
  const outputs = () => outputLines(props.flight);
  const lines = (): Line[] => [
    ...outputs().map((one, place): Line => ({ label: `rotor ${one.output}`, values: one.duty, colour: seriesColour(place), width: 1.2 })),
    ...outputs().flatMap((one, place): Line[] =>
      one.saturated.some((value) => value !== null) ? [{ label: `rotor ${one.output} saturated`, values: one.saturated, colour: seriesColour(place), points: true }] : [],
    ),
  ];
  return (
    <Chart
      title="Command of each motor" unit="%" x={props.flight.time_s} view={props.view} height={230} lines={lines()}
      levels={outputs().some((one) => one.saturated.some((value) => value !== null)) ? [{ value: 100 * props.flight.output_limit, label: "limit" }] : []}
    />
  );
}

const AXES = {
  accelerometer: ["forward", "right", "down"],
  gyroscope: ["roll", "pitch", "yaw"],
} as const;

function Spectra(props: { vibration: NonNullable<FlightPicture["vibration"]> }) {
  const it = () => props.vibration;
  const marks = () => it().rotors.map((one) => ({ from: one.low_hz, to: one.high_hz, at: one.median_hz, label: `rotor ${one.rotor}`, colour: seriesColour(one.rotor - 1) }));
  const spectrum = (title: string, unit: string, values: readonly (readonly (number | null)[])[] | null | undefined, names: readonly string[]) => (
    <Show when={values}>
      {(axes) => (
        <Chart
          title={title} unit={unit} x={it().frequency_hz} xLabel="frequency" xUnit="Hz" yLog height={230} marks={marks()}
          lines={axes().map((one, axis) => ({ label: names[axis] ?? "", values: one, colour: seriesColour(axis), width: 1.2 }))}
        />
      )}
    </Show>
  );
  return (
    <div class="stack">
      <div class="two">
        {spectrum("Vibration: accelerometer", "m/s²/√Hz", it().accelerometer, AXES.accelerometer)}
        {spectrum("Vibration: gyroscope", "rad/s/√Hz", it().gyroscope, AXES.gyroscope)}
      </div>
      <p class="small muted">
        Mean over {it().seconds.toFixed(0)} s in the air.{" "}
        <Show when={it().rotors.length > 0}>Shaded: how fast each rotor turned: {rotorSpeedWords(it().rotors)}. A damaged or unbalanced rotor shakes at its own frequency. </Show>
        <For each={it().notes}>{(one) => <>{one} </>}</For>
      </p>
    </div>
  );
}
