/** The vehicle in 3-D at a time of the flight. */
import { Show } from "solid-js";
import { type Schemas, ask } from "../../api/client";
import { createLoad } from "../../api/load";
import { type Samples, samplesOf } from "../../model/run";
import { Problem } from "../../parts/bits";
import type { View } from "../../plots/view";
import { type FullGeometry, LOG_CHANNELS, MOTION_CHANNELS } from "../../replay/motion";
import { Replay } from "../../replay/replay";
import type { Twin } from "./state";

export function Flight(props: { twin: Twin; view: View }) {
  const geometry = createLoad(() => props.twin.vehicle(), (name, signal) => ask<FullGeometry>("GET", `/api/v1/vehicles/${encodeURIComponent(name)}/geometry`, undefined, { signal }));
  const track = createLoad(
    () => ({ log: props.twin.compared()[props.twin.logAt()], run: props.twin.runs()[0] }),
    async ({ log, run }, signal): Promise<Samples> => {
      if (log === undefined) return samplesOf(run ?? "", MOTION_CHANNELS, 4000, undefined, signal);
      const query = new URLSearchParams({ channels: LOG_CHANNELS, points: "4000" });
      const answer = await ask<Schemas["Telemetry"]>("GET", `/api/v1/logs/${log}/telemetry?${query}`, undefined, { signal });
      return { time: (answer.data["time_s"] ?? []) as number[], data: answer.data, units: answer.units };
    },
  );
  return (
    <>
      <Problem sentence={geometry.error() ?? track.error()} retry={() => { geometry.reload(); track.reload(); }} />
      <Show when={geometry.data()} keyed>
        {(vehicle) => <Show when={track.data()}>{(found) => <Replay geometry={vehicle} track={found()} view={props.view} live={false} />}</Show>}
      </Show>
    </>
  );
}
