/** The flights of a report over time: each flight, and measured against model in every channel, on one time axis. */
import { For, Show } from "solid-js";
import type { FlightPicture } from "../model/flight";
import { Panel } from "../parts/bits";
import type { Lane } from "../plots/lanes";
import { createView } from "../plots/view";
import type { ComparisonReport } from "./compared-series";
import { ComparedPanel } from "./compared";
import { FlightLanes, FlightPlots } from "./flight";

export interface OverTime {
  flights: FlightPicture[];
  compared: ComparisonReport | null;
  not_compared: string | null;
}

/** `lanes`: additional lanes on a log's time axis, by its name. */
export function OverTimeView(props: { data: OverTime; lanes?: (log: string) => readonly Lane[] }) {
  return (
    <Show
      when={props.data.compared}
      fallback={
        <>
          <Show when={props.data.not_compared}>{(why) => <p class="say warn">Measured against model is not drawn: {why()}</p>}</Show>
          <For each={props.data.flights}>{(flight) => <Alone flight={flight} lanes={props.lanes?.(flight.name) ?? []} />}</For>
        </>
      }
    >
      {(compared) => <ComparedPanel title="The flight: measured against model" report={{ ...compared(), flights: props.data.flights }} {...(props.lanes ? { lanes: props.lanes } : {})} />}
    </Show>
  );
}

function Alone(props: { flight: FlightPicture; lanes: readonly Lane[] }) {
  const view = createView();
  return (
    <Panel title={`The flight ${props.flight.name}`}>
      <div class="stack">
        <FlightLanes flight={props.flight} view={view} more={props.lanes} />
        <FlightPlots flight={props.flight} view={view} />
      </div>
    </Panel>
  );
}
