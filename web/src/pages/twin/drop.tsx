/** Step 1: a flight. Three examples, files that are dropped or chosen, or a run of this server. */
import { For, Show, createSignal } from "solid-js";
import { type Schemas, address, ask, get, upload } from "../../api/client";
import { tooLarge } from "../../api/limits";
import type { JobView } from "../../api/job";
import { createLoad } from "../../api/load";
import { sentenceOf } from "../../api/problem";
import { bytes, moment, percent } from "../../format";
import { Problem, Progress } from "../../parts/bits";
import { JobProgress } from "../../parts/job";
import { Step } from "./step";
import type { Twin } from "./state";

const EXAMPLES = [
  { preset: "hidden-effect", title: "A hidden effect", text: "The independent simulator flies a hexarotor with physics that its model lacks. What is it, and how large?" },
  { preset: "damaged-blade", title: "A damaged blade", text: "A blade breaks in mid-flight, and one rotor loses some lift. Which one, when, and how much?" },
  { preset: "healthy", title: "A healthy flight", text: "Nothing is hidden. Does the twin say so?" },
] as const;
const ENDINGS = ".ulg,.bin,.log,.tlog,.bbl,.bfl,.txt,.mcap,.db3,.csv,.tsv,.parquet,.usd";

export function Drop(props: { twin: Twin }) {
  const [over, setOver] = createSignal(false);
  const [sending, setSending] = createSignal<{ name: string; share: number; stop: () => void }>();
  const [problem, setProblem] = createSignal<string>();
  const [asked, setAsked] = createSignal<string>();
  const [picking, setPicking] = createSignal(false);
  const runs = createLoad(() => picking() || undefined, (_, signal) => get("/api/v1/runs", { query: { status: "done", limit: 30 }, signal }));
  const logs = createLoad(() => picking() || undefined, (_, signal) => get("/api/v1/logs", { query: { status: "done", limit: 30 }, signal }));
  const chosen = () => props.twin.logs().length + props.twin.runs().length > 0;

  const send = async (files: readonly File[]) => {
    setProblem(undefined);
    const ids: string[] = [];
    for (const file of files) {
      const ending = /\.([^.]*)$/.exec(file.name)?.[1];
      if (ending !== undefined && !ENDINGS.split(",").includes(`.${ending.toLowerCase()}`)) {
        setProblem(`${file.name} (${bytes(file.size)}): ends with '${ending}'; expected a flight log, one of ${ENDINGS.replaceAll(",", ", ")}, or a Crazyflie log, which has no ending.`);
        break;
      }
      const control = new AbortController();
      setSending({ name: file.name, share: 0, stop: () => control.abort() });
      try {
        // Do not upload a file only to learn that it is too large.
        const refusal = await tooLarge(file);
        if (refusal) {
          setProblem(refusal);
          break;
        }
        const url = address("/api/v1/logs", { query: { name: plainName(file.name) } });
        const job = await upload<JobView>(url, file, (share) => setSending((before) => before && { ...before, share }), control.signal);
        ids.push(job.id);
      } catch (error) {
        setProblem(`${file.name} (${bytes(file.size)}): ${sentenceOf(error)}`);
        break;
      }
    }
    setSending(undefined);
    // The first flight is for training; the others are held out for validation.
    if (ids[0] !== undefined) {
      props.twin.choose({ logs: [ids[0]] });
      if (ids.length > 1) props.twin.hold(ids.slice(1));
    }
  };
  const example = async (preset: string) => {
    setProblem(undefined);
    setAsked(preset);
    try {
      const job = await ask<JobView>("POST", "/api/v1/logs/generate", { preset });
      props.twin.choose({ logs: [job.id] });
    } catch (error) {
      setProblem(sentenceOf(error));
    } finally {
      setAsked(undefined);
    }
  };

  return (
    <Step
      number={1}
      title="A flight"
      later="a flight log"
      state={!chosen() ? "working" : props.twin.log.error() ? "problem" : props.twin.flightsReady() ? "done" : "working"}
      note={chosen() ? flightName(props.twin) : "a log of your own, an example, or a run of this server"}
      actions={<Show when={chosen()}><button type="button" onClick={() => props.twin.choose({})}>Other flight</button></Show>}
    >
      <Show when={!chosen()}>
        <div class="three">
          <For each={EXAMPLES}>
            {(one) => (
              <div class="card">
                <h3>{one.title}</h3>
                <p class="small">{one.text}</p>
                <button type="button" class="main" disabled={asked() !== undefined} onClick={() => void example(one.preset)}>
                  {asked() === one.preset ? "Asking …" : "Fly it"}
                  <span class="sr">: {one.title}</span>
                </button>
              </div>
            )}
          </For>
        </div>
        <div
          class="drop"
          classList={{ over: over() }}
          onDragOver={(event) => { event.preventDefault(); setOver(true); }}
          onDragLeave={() => setOver(false)}
          onDrop={(event) => { event.preventDefault(); setOver(false); void send([...(event.dataTransfer?.files ?? [])]); }}
        >
          <p><strong>Drop a log here</strong>, or several of one vehicle: the first is learnt from, the others are held out as proof.</p>
          <p class="small muted">PX4 .ulg, ArduPilot .bin and .log, MAVLink .tlog, Betaflight and INAV .bbl, .bfl and .txt, ROS 2 .mcap and .db3, .parquet, Crazyflie logs without an ending; a .csv of any program: where its columns have other names, you are asked what they are.</p>
          <label class="button">
            Choose files
            <input class="sr" type="file" multiple accept={`${ENDINGS},application/octet-stream`} onChange={(event) => { void send([...(event.currentTarget.files ?? [])]); event.currentTarget.value = ""; }} />
          </label>
        </div>
        <details onToggle={(event) => setPicking(event.currentTarget.open)}>
          <summary>A run or a log that is on this server</summary>
          <Problem sentence={runs.error() ?? logs.error()} />
          <div class="two">
            <Pick title="Runs" items={runs.data()?.items ?? []} choose={(id) => props.twin.choose({ runs: [id] })} />
            <Pick title="Logs" items={logs.data()?.items ?? []} choose={(id) => props.twin.choose({ logs: [id] })} />
          </div>
        </details>
      </Show>
      <Show when={sending()}>
        {(one) => (
          <div class="row" role="status">
            <Progress share={one().share} what="upload" />
            <span>Sending {one().name}: {percent(one().share, 0)}</span>
            <button type="button" onClick={() => one().stop()}>Cancel</button>
          </div>
        )}
      </Show>
      <Problem sentence={problem()} />
      <JobProgress job={props.twin.log} what="Importing the log" />
      <For each={props.twin.heldProblems()}>{(one) => <Problem sentence={one} />}</For>
    </Step>
  );
}

/** A valid name for the server: other characters become `_`. */
const plainName = (name: string) => name.normalize("NFKD").replace(/[^A-Za-z0-9._\- ()+]/g, "_").slice(-200);

function flightName(twin: Twin): string {
  const name = twin.logs().length > 0 ? (twin.log.job()?.name ?? "log") : `run ${twin.runs()[0]?.slice(0, 12) ?? ""}`;
  const held = twin.held().length;
  return held > 0 ? `${name}; ${held} more held out` : name;
}

function Pick(props: { title: string; items: readonly (Schemas["Run"] | Schemas["JobView"])[]; choose: (id: string) => void }) {
  return (
    <div>
      <h3>{props.title}</h3>
      <ul class="plain">
        <For each={props.items} fallback={<li class="muted">none</li>}>
          {(item) => (
            <li class="row small">
              <button type="button" class="plain" onClick={() => props.choose(item.id)}>{item.name}</button>
              <span class="muted num">{moment(item.submitted_ms)}</span>
            </li>
          )}
        </For>
      </ul>
    </div>
  );
}
