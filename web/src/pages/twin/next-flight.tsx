/** In step 5, if a flight cannot distinguish two effects: a manoeuvre that does, flown in the simulator, and as a file for the real vehicle. */
import { For, Show, createSignal } from "solid-js";
import { createAttempt } from "../../api/attempt";
import { type Schemas, ask, freshKey, putDocument, text as fetchText } from "../../api/client";
import { type JobView, createJob } from "../../api/job";
import { short } from "../../format";
import { type Manoeuvre, candidatesOf, withVehicle } from "../../model/next-flight";
import type { Diagnosis } from "../../model/twin";
import { Problem, StatusTag, saveText } from "../../parts/bits";
import { JobProgress } from "../../parts/job";
import { createTyped } from "../../typed";
import type { Twin } from "./state";

/** Threshold for a decision of the diagnosis. */
const DECISIVE = 10;
const FILE = "next-flight.toml";

export function NextFlight(props: { twin: Twin; found: Diagnosis }) {
  const candidates = () => candidatesOf(props.found);
  const [first, setFirst] = createSignal(0);
  const [second, setSecond] = createSignal(1);
  const { busy, problem, attempt } = createAttempt();
  const job = createJob<Manoeuvre[]>("next-flights", () => props.twin.nextFlight());
  const find = () => attempt(async () => {
    const [a, b] = [candidates()[first()], candidates()[second()]];
    const made = await ask<JobView>("POST", "/api/v1/next-flights", { model: { model: `${props.twin.model()}@v${props.twin.line().at(-1)?.version}` }, between: [a?.id, b?.id] }, { headers: { "idempotency-key": freshKey() } });
    props.twin.proposeFlight(made.id);
  });
  const pick = (title: string, value: () => number, set: (place: number) => void) => (
    <label class="field">{title}
      <select value={value()} onChange={(event) => set(Number(event.currentTarget.value))}>
        <For each={candidates()}>{(one, place) => <option value={place()} selected={place() === value()}>{one.label}</option>}</For>
      </select>
    </label>
  );
  return (
    <div class="say stack">
      <p>
        <strong>A short flight distinguishes them.</strong> Eleven manoeuvres are flown in the simulator with the current model; what each would show if one or the
        other effect were true says which is worth flying.
      </p>
        <div class="fields">
          <Show when={candidates().length > 2}>
            {pick("Distinguish", first, setFirst)}
            {pick("from", second, setSecond)}
          </Show>
          <button type="button" class="main" disabled={busy() || job.running() || first() === second()} onClick={() => void find()}>Find the manoeuvre that distinguishes them</button>
          <Show when={candidates().length === 2}><span class="small muted">{candidates()[0]?.label}, or {candidates()[1]?.label}?</span></Show>
        </div>
      <Problem sentence={problem()} />
      <JobProgress job={job} what="Flying eleven manoeuvres" />
      <Show when={job.result()}>{(list) => <Proposed twin={props.twin} list={list()} job={job.job()} id={props.twin.nextFlight() ?? ""} labels={candidates()} />}</Show>
    </div>
  );
}

function Proposed(props: { twin: Twin; list: readonly Manoeuvre[]; job: JobView | undefined; id: string; labels: readonly { id: string; label: string }[] }) {
  const best = () => props.list[0];
  const between = () => ((props.job?.facts ?? {}) as Partial<Schemas["NextFlightFacts"]>).between ?? ["the first", "the second"];
  const label = (place: 0 | 1) => props.labels.find((one) => one.id === between()[place])?.label ?? between()[place];
  const worth = () => Math.min(best()?.first.against_other ?? 0, best()?.second.against_other ?? 0);
  const file = () => `/api/v1/next-flights/${props.id}/artifacts/${FILE}`;
  const { busy, problem, attempt } = createAttempt();
  const [said, setSaid] = createSignal("");
  const [name, setName] = createTyped("next-flight.name", "next-flight");
  const flown = createJob<unknown>("runs", () => props.twin.flown());
  const act = (what: () => Promise<void>) => {
    setSaid("");
    return attempt(what);
  };
  const version = () => `${props.twin.model()}@v${props.twin.line().at(-1)?.version}`;
  // The server's text refers to a file of its own.
  const scenario = async () => `# Distinguishes ${between()[0]} from ${between()[1]}; proposed for the model ${version()}.\n${withVehicle(await fetchText(file()), props.twin.vehicle())}`;
  const take = () => act(async () => saveText(`${best()?.manoeuvre ?? "next-flight"}.toml`, await scenario()));
  const fly = () => act(async () => {
    const run = await ask<Schemas["Run"]>("POST", "/api/v1/runs", { text: await scenario(), model: { model: version() } });
    props.twin.fly(run.id);
  });
  const copy = () => act(async () => {
    await putDocument(`/api/v1/scenarios/${encodeURIComponent(name().trim())}`, await scenario());
    setSaid(`It is in the library as the scenario ${name().trim()}.`);
  });
  return (
    <Show when={best()} fallback={<p>No manoeuvre can be flown by this vehicle that would distinguish {label(0)} from {label(1)}.</p>}>
      {(one) => (
        <div class="stack">
          <p class={worth() < DECISIVE ? "say warn" : "say good"} role="status">
            <Show when={worth() >= DECISIVE} fallback={<>No manoeuvre of the list distinguishes {label(0)} from {label(1)} at their ordinary sizes; the best is <strong>{one().manoeuvre}</strong>, with {short(worth())} where {DECISIVE} decide.</>}>
              Fly <strong>{one().manoeuvre}</strong> ({one().description}, {short(one().duration_s)} s): expected ln Bayes factor {short(one().first.against_other)} if it is {label(0)}, {short(one().second.against_other)} if it is {label(1)}.
            </Show>
          </p>
          <div class="scroll" tabindex="0" role="region" aria-label="Manoeuvres, best first">
            <table class="small">
              <thead><tr><th scope="col">Manoeuvre</th><th class="r" scope="col">s</th><th class="r" scope="col">{label(0)} is true</th><th scope="col">strongest rival</th><th class="r" scope="col">{label(1)} is true</th><th scope="col">strongest rival</th></tr></thead>
              <tbody>
                <For each={props.list}>
                  {(row) => (
                    <tr>
                      <td>{row.manoeuvre}: {row.description}</td><td class="r">{short(row.duration_s)}</td>
                      <td class="r">{short(row.first.against_other)}</td><td>{row.first.strongest_rival} ({short(row.first.against_all)})</td>
                      <td class="r">{short(row.second.against_other)}</td><td>{row.second.strongest_rival} ({short(row.second.against_all)})</td>
                    </tr>
                  )}
                </For>
              </tbody>
            </table>
          </div>
          <p class="small">
            Numbers are expected natural logarithms of the Bayes factor (above {DECISIVE}: decided). <strong>The real vehicle has to fly it</strong>: the simulator knows the
            model and nothing more, so its flight shows what to fly and cannot answer the question. Then drop the log of that flight in step 1.
          </p>
          <div class="fields">
            <button type="button" class="main" disabled={busy()} onClick={() => void fly()}>Fly it in the simulator</button>
            <button type="button" disabled={busy()} onClick={() => void take()}>Take the scenario as a file</button>
            <label class="field">Copy it into the library as<input type="text" size="16" value={name()} onInput={(event) => setName(event.currentTarget.value)} /></label>
            <button type="button" disabled={busy() || !name().trim()} onClick={() => void copy()}>Copy</button>
            <span role="status" class="small">{said()}</span>
          </div>
          <Problem sentence={problem() ?? flown.error()} />
          <Show when={props.twin.flown()}>
            {(id) => <p class="row"><StatusTag status={flown.job()?.status ?? "loading"} /><a href={`/runs/${id()}`}>Watch {one().manoeuvre} as a run, with its 3-D picture</a></p>}
          </Show>
        </div>
      )}
    </Show>
  );
}
