/** One run, live and afterwards: summary, 3-D, verdicts with the truth, residuals, duties, battery; one cursor for all. */
import { For, Show, createEffect, createMemo, createSignal, on, onCleanup } from "solid-js";
import { type Schemas, ask, freshKey, get, remove } from "../api/client";
import { createLoad } from "../api/load";
import { hasEnded, watchJob } from "../api/news";
import { sentenceOf } from "../api/problem";
import { percent, verdictText } from "../format";
import { createLive } from "../model/live-run";
import { type Samples, type Summary, faultIntervals, samplesOf } from "../model/run";
import { Panel, Problem, Progress, StatusTag } from "../parts/bits";
import { createView } from "../plots/view";
import { type FullGeometry, MOTION_CHANNELS } from "../replay/motion";
import { Replay } from "../replay/replay";
import { navigate, route } from "../router";
import { Compared, Overlay } from "./run-overlay";
import { RunPlots } from "../shown/run-plots";
import { RunSummary } from "../shown/run-summary";
import { RunFiles } from "./run-files";

type Run = Schemas["Run"];
const PLOT_POINTS = 1600;
const MOTION_POINTS = 4000;

export default function RunPage(props: { id: string }) {
  const id = props.id;
  const view = createView(undefined, () => faultIntervals(summary()));
  const [run, setRun] = createSignal<Run>();
  const [problem, setProblem] = createSignal<string>();
  const [progress, setProgress] = createSignal<Record<string, unknown>>({});
  const [watch, setWatch] = createSignal(0);
  createEffect(
    on(watch, () => {
      const stop = watchJob<Run & { result?: unknown }>("runs", id, setRun, (event, data) => event === "progress" && setProgress(data), (error) => setProblem(sentenceOf(error)));
      onCleanup(stop);
    }),
  );
  const ended = () => hasEnded(run()?.status);
  const recorded = createMemo(() => (ended() && (run()?.bytes ?? 0) > 0 ? id : undefined));
  const live = createLive(id, createMemo(() => run() !== undefined && !ended()));
  const summary = () => (run()?.summary ?? undefined) as Summary | undefined;

  const geometry = createLoad(() => run()?.id, (run, signal) => ask<FullGeometry>("GET", `/api/v1/runs/${run}/geometry`, undefined, { signal }));
  const plots = createLoad(
    () => (recorded() ? { range: view.range() } : undefined),
    ({ range }, signal) => samplesOf(id, "*", PLOT_POINTS, range, signal),
  );
  const motion = createLoad(recorded, (run, signal) => samplesOf(run, MOTION_CHANNELS, MOTION_POINTS, undefined, signal));
  const flight = createMemo(() => {
    const [campaign, number] = [route().query.get("campaign"), route().query.get("flight")];
    return campaign && number !== null ? { campaign, flight: Number(number) } : undefined;
  }, undefined, { equals: (a, b) => a?.campaign === b?.campaign && a?.flight === b?.flight });
  const others = () => (route().query.get("with") ?? "").split(",").filter(Boolean);
  const ghost = createLoad(() => others()[0], (other, signal) => samplesOf(other, MOTION_CHANNELS, MOTION_POINTS, undefined, signal));

  const shown = (): Samples | undefined => (recorded() ? plots.data() : live.plots());
  const flown = (): Samples | undefined => (recorded() ? motion.data() : live.frame());

  const act = async (what: () => Promise<unknown>) => {
    setProblem(undefined);
    try {
      await what();
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  const cancel = () => act(async () => {
    const asked = await ask<Run>("POST", `/api/v1/runs/${id}/cancel`);
    // The event of its end may have overtaken this answer.
    setRun((now) => (hasEnded(now?.status) ? now : asked));
  });
  const [verified, setVerified] = createSignal<Schemas["Verification"] | "running">();
  const fork = () => act(async () => {
    const made = await ask<Run>("POST", `/api/v1/runs/${id}/fork`, { healthy: true });
    navigate(`/runs/${made.id}?with=${id}`);
  });
  let verification = new AbortController();
  const verify = () => act(async () => {
    setVerified("running");
    verification = new AbortController();
    const { signal } = verification;
    try {
      // While it continues the server answers with its job, and the same key waits for it again.
      const headers = { "idempotency-key": freshKey() };
      let answer: Schemas["Verification"] | Schemas["JobView"];
      do {
        answer = await ask("POST", `/api/v1/runs/${id}/verify`, undefined, { headers, signal });
      } while (!("same" in answer));
      setVerified(answer);
    } catch (error) {
      setVerified(undefined);
      if (!signal.aborted) throw error;
    }
  });
  const stopVerifying = () => act(async () => {
    verification.abort();
    const open = await Promise.all((["queued", "running"] as const).map((status) => get("/api/v1/verifications", { query: { status, limit: 100 } })));
    const ours = open.flatMap((one) => one.items).filter((job) => (job.facts as Partial<Schemas["VerificationFacts"]> | null | undefined)?.run === id);
    await Promise.all(ours.map((job) => ask("POST", `/api/v1/verifications/${job.id}/cancel`)));
  });
  const share = () => {
    const [step, steps] = [progress()["step"], progress()["step_count"]];
    return typeof step === "number" && typeof steps === "number" && steps > 0 ? step / steps : undefined;
  };

  return (
    <>
      <div class="row">
        <h1>{run()?.name ?? "Run"}</h1>
        <Show when={run()?.status ?? (problem() ? undefined : "loading")}>{(status) => <StatusTag status={status()} />}</Show>
        <span class="muted">{run()?.vehicle}{run() ? `, seed ${run()?.seed}` : ""}</span>
        <span class="mono small muted break">{id}</span>
        <span class="grow" />
        <Show when={run() && !ended()}>
          <button type="button" disabled={run()?.cancel_requested} onClick={() => void cancel()}>
            {run()?.cancel_requested ? "Canceling …" : "Cancel"}
          </button>
        </Show>
        <Show when={run()?.status === "done"}>
          <button type="button" onClick={() => void fork()}>Fork healthy</button>
          <button type="button" disabled={verified() === "running"} onClick={() => void verify()}>{verified() === "running" ? "Flying again …" : "Verify"}</button>
          <Show when={verified() === "running"}><button type="button" onClick={() => void stopVerifying()}>Cancel<span class="sr"> the verification</span></button></Show>
          <a class="button" href={`/twin?run=${id}`}>Compare a model with it</a>
        </Show>
        <Show when={ended()}>
          <button type="button" class="danger" onClick={() => confirm(`Delete the run ${run()?.name} and its files?`) && void act(async () => { await remove(`/api/v1/runs/${id}`); navigate("/runs"); })}>Delete</button>
        </Show>
      </div>
      <Problem sentence={problem()} retry={() => { setProblem(undefined); setWatch((count) => count + 1); }} />
      <Show when={verificationOf(verified())} keyed>
        {(found) => (
          <div class={`say ${found.same ? "good" : "bad"}`} role="status">
            {found.same ? `The same bits: run hash ${found.again}` : `Different: recorded ${found.recorded}, again ${found.again}`} ({(found.wall_ms / 1000).toFixed(1)} s).
          </div>
        )}
      </Show>
      <Show when={flight()} keyed>{(from) => <SameAsFlight campaign={from.campaign} flight={from.flight} run={run()} />}</Show>
      {/* The summary says why a flight failed, with the peer and the step. */}
      <Show when={summary()?.failure ? undefined : run()?.error}>{(why) => <div class={`say ${run()?.status === "canceled" ? "warn" : "bad"}`}>{why()}</div>}</Show>
      <For each={run()?.warnings ?? []}>{(warning) => <div class="say warn">{warning}</div>}</For>
      <Show when={run() && !ended()}>
        <Panel title={run()?.status === "queued" ? "Waiting in the queue" : "Flying"} note={live.lost() > 0 ? `${live.lost()} samples were not shown: this browser is too slow` : undefined}>
          <div class="row">
            <Progress share={share()} what="share of the flight" />
            <span class="num">{percent(share(), 0)}</span>
            <span class="muted">
              sequential detector: {verdictText(progress()["sequential"] as number | undefined)}; truth: {verdictText(progress()["fault_label"] as number | undefined)}
            </span>
          </div>
          <Show when={live.note()}><p class="small muted">{live.note()}</p></Show>
        </Panel>
      </Show>
      <Show when={summary()}>{(found) => <RunSummary summary={found()} />}</Show>

      <Show when={run()}>
      <Panel title="Replay" note={others()[0] ? `ghost: run ${others()[0]?.slice(0, 12)}` : undefined}>
        <Problem sentence={geometry.error() && `The 3-D picture needs the geometry of the vehicle: ${geometry.error()}`} retry={geometry.reload} />
        <Problem sentence={motion.error()} retry={motion.reload} />
        <Problem sentence={ghost.error() && `The other run: ${ghost.error()}`} />
        <Show when={geometry.data()} keyed>
          {(vehicle) => (
            <Show when={(flown()?.time.length ?? 0) > 0} fallback={<p class="muted">{ended() && (!recorded() || summary()?.steps === 0) ? "Nothing was recorded." : "Waiting for samples …"}</p>}>
              <Replay geometry={vehicle} track={flown() as Samples} ghost={ghost.data()} view={view} live={!ended()} />
            </Show>
          )}
        </Show>
      </Panel>
      </Show>

      <Problem sentence={plots.error()} retry={plots.reload} />
      <Show when={(shown()?.time.length ?? 0) > 0}>
        <RunPlots samples={shown() as Samples} view={view} />
      </Show>
      <Show when={ended()}><Compared id={id} others={others()} /></Show>
      <Overlay id={id} others={others()} samples={shown()} view={view} />
      <Show when={recorded()}><RunFiles id={id} /></Show>
    </>
  );
}

const verificationOf = (value: Schemas["Verification"] | "running" | undefined) => (value === "running" ? undefined : value);

/** Whether this run, a flight of a campaign, has the samples that the campaign judged. */
function SameAsFlight(props: { campaign: string; flight: number; run: Run | undefined }) {
  const row = createLoad(
    () => props,
    async ({ campaign, flight }, signal) => (await get("/api/v1/campaigns/{id}/flights", { path: { id: campaign }, query: { cursor: flight, limit: 1 }, signal })).items[0],
  );
  const there = () => row.data()?.run_hash;
  const same = () => (there() && props.run?.run_hash ? there() === props.run.run_hash : undefined);
  return (
    <>
      <Problem sentence={row.error() && `The campaign of this flight: ${row.error()}`} />
      <div class={`say ${same() === undefined ? "" : same() ? "good" : "bad"}`} role="status">
        Flight {props.flight} of <a href={`/campaigns/${props.campaign}`}>a campaign</a>
        {same() === undefined ? "." : same() ? `: the same samples as there, run hash ${there()}.` : `: not the samples of the campaign, which has run hash ${there()}; another version of the program has flown it.`}
      </div>
    </>
  );
}
