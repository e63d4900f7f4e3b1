/** The detectors as a service: a log to be judged, and the state of the user's sessions. */
import { For, Show, createMemo, createSignal, onCleanup } from "solid-js";
import { createAttempt } from "../api/attempt";
import { type Schemas, address, ask, get, upload } from "../api/client";
import { tooLarge } from "../api/limits";
import { type Session, watchSessions } from "../api/fdi-news";
import { createLoad } from "../api/load";
import { ApiError } from "../api/problem";
import { bytes, percent, short } from "../format";
import { Figures, Panel, Problem, Progress } from "../parts/bits";
import { Lanes } from "../plots/lanes";
import { route } from "../router";
import { Judged, changesToStretches, verdictWords } from "../shown/judged";

type Report = Schemas["LogReport"];

export default function Fdi() {
  return (
    <>
      <div class="row">
        <h1>FDI monitor</h1>
        <span class="muted">Fault detection and isolation: is a rotor losing thrust, which one, and how much?</span>
      </div>
      <Judge />
      <Sessions />
    </>
  );
}

function Judge() {
  const names = createLoad(() => true, async (_, signal) => (await get("/api/v1/vehicles", { signal })).items);
  const logs = createLoad(() => true, (_, signal) => get("/api/v1/logs", { query: { status: "done", limit: 30 }, signal }));
  const most = createLoad(() => true, async (_, signal) => (await get("/api/v1/limits", { signal })).largest_judged_log);
  const [vehicle, setVehicle] = createSignal("f550");
  const [log, setLog] = createSignal(route().query.get("log") ?? "");
  const [share, setShare] = createSignal<number>();
  const { busy, problem, attempt } = createAttempt();
  const [report, setReport] = createSignal<Report>();
  const [over, setOver] = createSignal(false);
  const [canceled, setCanceled] = createSignal(false);
  let control = new AbortController();
  const judge = (what: (signal: AbortSignal) => Promise<Report>) => {
    setReport(undefined);
    setCanceled(false);
    control = new AbortController();
    const { signal } = control;
    return attempt(async () => {
      try {
        setReport(await what(signal));
      } catch (error) {
        // The request ends, and with it what the server does for it.
        if (!signal.aborted) throw error;
      } finally {
        setShare(undefined);
      }
    });
  };
  onCleanup(() => control.abort());
  const cancel = () => {
    setCanceled(true);
    control.abort();
  };
  const send = (file: File | undefined) => {
    if (!file) return;
    void judge(async (signal) => {
      const refusal = await tooLarge(file, true);
      if (refusal) throw new ApiError(0, refusal);
      return upload<Report>(address("/api/v1/fdi/reports", { query: { vehicle: vehicle(), flight: true } }), file, setShare, signal);
    });
  };
  return (
    <Panel title="Judge a log" note="verdicts over time, how it ended, what the log lacks">
      <div class="stack">
        <Problem sentence={names.error() ?? logs.error()} />
        <div class="fields">
          <label class="field">Vehicle
            <select value={vehicle()} onChange={(event) => setVehicle(event.currentTarget.value)}>
              <For each={names.data() ?? ["f550"]}>{(name) => <option value={name} selected={name === vehicle()}>{name}</option>}</For>
            </select>
          </label>
          <label class="field">Log of this server
            <select value={log()} onChange={(event) => setLog(event.currentTarget.value)}>
              <option value="">choose</option>
              <For each={logs.data()?.items ?? []}>{(one) => <option value={one.id} selected={one.id === log()}>{one.name} {one.id.slice(0, 8)}</option>}</For>
            </select>
          </label>
          <button type="button" class="main" disabled={!log() || busy()} onClick={() => void judge((signal) => ask<Report>("POST", address("/api/v1/fdi/reports", { query: { vehicle: vehicle(), log: log(), flight: true } }), undefined, { signal }))}>Judge</button>
        </div>
        <div
          class="drop" classList={{ over: over() }}
          onDragOver={(event) => { event.preventDefault(); setOver(true); }} onDragLeave={() => setOver(false)}
          onDrop={(event) => { event.preventDefault(); setOver(false); send(event.dataTransfer?.files[0]); }}
        >
          Drop a log here (<Show when={most.data()}>{(size) => <>{bytes(size())} at most; </>}</Show>it is not kept), or{" "}
          <label class="button">choose a file<input class="sr" type="file" onChange={(event) => { send(event.currentTarget.files?.[0]); event.currentTarget.value = ""; }} /></label>
        </div>
        <Show when={busy()}><div class="row" role="status"><Progress share={share()} what="judging" /> {share() === undefined || share() === 1 ? "Judging …" : `Sending: ${percent(share(), 0)}`} <button type="button" onClick={cancel}>Cancel</button></div></Show>
        <div role="status"><Show when={canceled()}><p class="small">It was canceled.</p></Show></div>
        <Problem sentence={problem()} />
        <Show when={report()}>{(found) => <Judged report={found()} />}</Show>
      </div>
    </Panel>
  );
}

function Sessions() {
  const [sessions, setSessions] = createSignal<readonly Session[]>();
  const [refusal, setRefusal] = createSignal<string>();
  onCleanup(watchSessions((all) => setSessions(all), setRefusal));
  return (
    <Panel title="Sessions" note="verdicts on samples that your programs send while the vehicle flies">
      <Problem sentence={refusal() && `Sessions cannot be watched: ${refusal()}`} />
      {/* By id: a card stays, with what is open in it, while its numbers change ten times a second. */}
      <For each={(sessions() ?? []).map((one) => one.id)} fallback={<Show when={sessions()}><p class="muted">No session is open. A program opens one with POST /api/v1/fdi/sessions.</p></Show>}>
        {(id) => {
          const session = createMemo<Session | undefined>((last) => sessions()?.find((one) => one.id === id) ?? last);
          return <Show when={session()}>{(one) => <Card session={one()} />}</Show>;
        }}
      </For>
    </Panel>
  );
}

function Card(props: { session: Session }) {
  const it = () => props.session;
  const end = () => it().next_step / it().rate_hz;
  return (
    <article class="card" aria-label={`Session ${it().id}`}>
      <div class="row"><h3>{it().detectors.vehicle}</h3><span class="mono small muted">{it().id}</span><span class="tag">calibration: {it().calibration}</span></div>
      <Show when={it().last?.sequential} fallback={<p class="muted">no verdict yet</p>}>{(word) => <p>{verdictWords(word())}</p>}</Show>
      <Show when={it().cannot_judge}>{(why) => <div class="say warn">{why().why}</div>}</Show>
      <Figures items={[
        ["samples", it().samples.toLocaleString("en")], ["rate", `${short(it().rate_hz)} Hz`], ["bridged gaps", `${it().bridged_steps} steps`],
        ["rejected samples", String(it().rejected_samples)], ["restarts", String(it().restarts)],
      ]} />
      <Lanes title={`Verdicts of session ${it().id}`} start={0} end={Math.max(1, end())} lanes={[{ name: "sequential", stretches: changesToStretches(it().changes, end()) }]} />
    </article>
  );
}
