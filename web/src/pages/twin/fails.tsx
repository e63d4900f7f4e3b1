/** Step 4: where the model fails. */
import { type Accessor, Show } from "solid-js";
import { ask, get } from "../../api/client";
import { createLoad } from "../../api/load";
import type { FlightPicture } from "../../model/flight";
import { isOfMotors, motorsWithoutCommand } from "../../model/repair";
import type { Series } from "../../model/twin";
import { Problem } from "../../parts/bits";
import { JobProgress } from "../../parts/job";
import { ComparisonView, type Looks, type Wanted } from "../../shown/comparison";
import { Flight } from "./flight";
import { OtherVehicle } from "./other-vehicle";
import { Step } from "./step";
import type { Twin } from "./state";

const BUCKETS = 800;

export function Fails(props: { twin: Twin }) {
  const result = () => props.twin.comparison.result();
  const refusal = () => props.twin.comparison.error();
  const state = () => {
    if (props.twin.comparison.error()) return "problem" as const;
    if (result()) return "done" as const;
    return props.twin.ready() ? ("working" as const) : ("waiting" as const);
  };
  const series = (wanted: Accessor<Wanted>) =>
    createLoad(
      () => {
        const id = result() && props.twin.comparison.job()?.id;
        return id ? { id, ...wanted() } : undefined;
      },
      ({ id, channel, log, range }, signal) => {
        const query = new URLSearchParams({ log: String(log), channel, points: String(BUCKETS) });
        if (range) {
          query.set("from_s", String(range[0]));
          query.set("to_s", String(range[1]));
        }
        return ask<Series>("GET", `/api/v1/comparisons/${id}/series?${query}`, undefined, { signal });
      },
    );
  const conditions: Looks["conditions"] = (wanted) =>
    createLoad(
      () => {
        const [id, log] = [result() && props.twin.comparison.job()?.id, wanted()];
        return id && log !== undefined ? { id, log } : undefined;
      },
      ({ id, log }, signal) => get("/api/v1/comparisons/{id}/conditions", { path: { id }, query: { log, points: BUCKETS }, signal }),
    );
  const flight = createLoad(
    () => (result() ? { log: props.twin.compared()[props.twin.logAt()], run: props.twin.runs()[0] } : undefined),
    ({ log, run }, signal) => ask<FlightPicture>("GET", log === undefined ? `/api/v1/runs/${run}/flight` : `/api/v1/logs/${log}/flight`, undefined, { signal }),
  );
  const looks: Looks = {
    picture: () => flight.data(),
    logAt: () => props.twin.logAt(),
    chooseLog: (place) => props.twin.chooseLog(place),
    channel: () => props.twin.channel(),
    chooseChannel: (name) => props.twin.chooseChannel(name),
    series,
    conditions,
    flight: (view) => <Flight twin={props.twin} view={view} />,
  };
  return (
    <Step number={4} title="Where it fails" later="each measured channel against the model, over time and over the flight condition" state={state()} note={result() ? "each channel one step ahead, against its noise" : undefined}>
      <JobProgress job={{ ...props.twin.comparison, error: () => refusal() && motorsWithoutCommand(refusal() ?? "") }} what="Comparing the model with the flight" retry={props.twin.again} />
      <OtherVehicle twin={props.twin} when={props.twin.comparison.job()?.status === "failed" && !isOfMotors(refusal() ?? "")} />
      <Problem sentence={flight.error() && `No picture of the flight: ${flight.error()}`} retry={flight.reload} />
      <Show when={result()}>{(found) => <ComparisonView result={found()} looks={looks} />}</Show>
    </Step>
  );
}
