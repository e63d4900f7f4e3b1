/** Step 5: what is missing. */
import { Show, createSignal } from "solid-js";
import { type Schemas, get } from "../../api/client";
import { createLoad } from "../../api/load";
import { short } from "../../format";
import { candidatesOf } from "../../model/next-flight";
import { Problem } from "../../parts/bits";
import { JobProgress } from "../../parts/job";
import { DiagnosisView } from "../../shown/diagnosis";
import { NextFlight } from "./next-flight";
import { OtherVehicle } from "./other-vehicle";
import { Step } from "./step";
import type { Twin } from "./state";

/** How a model that is too far from the log is calibrated by command; here it is a button. */
const CALIBRATE_COMMAND = / \(`rotortwin vehicle from-log[^)]*\)/;

export function Missing(props: { twin: Twin }) {
  const result = () => props.twin.diagnosis.result();
  const state = () => {
    if (props.twin.diagnosis.error()) return "problem" as const;
    if (result()) return "done" as const;
    return props.twin.diagnosis.running() || props.twin.comparison.running() ? ("working" as const) : ("waiting" as const);
  };
  return (
    <Step number={5} title="What is missing" later="the physics that explains the error, with its size, its interval and what else it could be" state={state()} note={result() ? `${result()?.model.name} diagnosed` : undefined}>
      <JobProgress job={{ ...props.twin.diagnosis, error: () => props.twin.diagnosis.error()?.replace(CALIBRATE_COMMAND, "") }} what="Looking for what is missing" retry={props.twin.again} />
      <OtherVehicle twin={props.twin} when={CALIBRATE_COMMAND.test(props.twin.diagnosis.error() ?? "")} />
      <Show when={result()}>
        {(found) => (
          <DiagnosisView found={found()} compared={props.twin.comparison.result()} add={(what) => void props.twin.add(what)} calibrating={{ take: (corrections) => void props.twin.calibrate(corrections), fromLog: () => props.twin.openFromLog() }}>
            <Show when={["cannot-tell", "missing"].includes(found().verdict.kind) && candidatesOf(found()).length > 1 && found().effects.some((one) => one.also_compatible.length > 0)}>
              <NextFlight twin={props.twin} found={found()} />
            </Show>
            <Truth twin={props.twin} />
          </DiagnosisView>
        )}
      </Show>
    </Step>
  );
}

/** The hidden truth of an example. */
function Truth(props: { twin: Twin }) {
  const [shown, setShown] = createSignal(false);
  const facts = () => (props.twin.log.job()?.facts ?? {}) as Partial<Schemas["ExampleFacts"]>;
  const truth = createLoad(
    () => (shown() ? props.twin.logs()[0] : undefined),
    (id, signal) => get("/api/v1/logs/{id}/truth", { path: { id }, signal }),
  );
  return (
    <Show when={facts().example}>
      <div class="say">
        <Show when={truth.data()} fallback={<button type="button" onClick={() => setShown(true)}>Reveal what was hidden</button>}>
          {(found) => (
            <>
              <strong>The truth:</strong>{" "}
              {found().effects.length === 0
                ? "nothing was hidden; the flight is healthy."
                : found().effects.map((one) => `${one.id}${one.rotor ? `, rotor ${one.rotor}` : ""}: ${Object.entries(one.parameters).map(([name, value]) => `${name} = ${short(value, 4)}`).join(", ")}${one.onset_s ? `, from ${short(one.onset_s)} s` : ""}`).join("; ")}
            </>
          )}
        </Show>
        <Problem sentence={truth.error()} retry={truth.reload} />
      </div>
    </Show>
  );
}
