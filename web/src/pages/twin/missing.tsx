/** Step 5: what is missing. "Agrees", "the log is at fault", "cannot tell" and "not in the catalogue" are full answers. */
import { For, Show, createSignal } from "solid-js";
import { ask } from "../../api/client";
import { createLoad } from "../../api/load";
import { percent, plusMinus, short } from "../../format";
import { type Diagnosis, type Finding, type Proposal, channelTitle, evidenceWords } from "../../model/twin";
import { Problem } from "../../parts/bits";
import { JobProgress } from "../../parts/job";
import { Chart } from "../../plots/chart";
import { candidatesOf } from "../../model/next-flight";
import { NextFlight } from "./next-flight";
import { Step } from "./step";
import type { Twin } from "./state";

const HEADLINES: Record<Diagnosis["verdict"]["kind"], { words: string; kind: string }> = {
  agrees: { words: "The model agrees with the flight.", kind: "good" },
  missing: { words: "Physics is missing, and named.", kind: "warn" },
  "cannot-tell": { words: "Physics is missing, and this flight cannot tell which of these.", kind: "warn" },
  "partly-missing": { words: "Physics is missing, and named; it explains a part of the error, the rest is not in the catalogue.", kind: "warn" },
  "calibrate-first": { words: "Constants of this vehicle are guesses that the flight contradicts: calibrate it first.", kind: "warn" },
  "outside-catalogue": { words: "The error is real, and not in the catalogue of effects.", kind: "warn" },
  "log-fault": { words: "The log is at fault; the physics agrees.", kind: "bad" },
  "nothing-testable": { words: "Nothing of this log can be compared with the model.", kind: "bad" },
};

export function Missing(props: { twin: Twin }) {
  const result = () => props.twin.diagnosis.result();
  const state = () => {
    if (props.twin.diagnosis.error()) return "problem" as const;
    if (result()) return "done" as const;
    return props.twin.diagnosis.running() || props.twin.comparison.running() ? ("working" as const) : ("waiting" as const);
  };
  return (
    <Step number={5} title="What is missing" state={state()} note={result() ? `${result()?.model.name} diagnosed` : undefined}>
      <JobProgress job={props.twin.diagnosis} what="Looking for what is missing" retry={props.twin.again} />
      <Show when={result()}>{(found) => <Answer twin={props.twin} found={found()} />}</Show>
    </Step>
  );
}

function Answer(props: { twin: Twin; found: Diagnosis }) {
  const headline = () => HEADLINES[props.found.verdict.kind];
  const canAdd = () => props.found.verdict.kind !== "agrees";
  return (
    <>
      <div class={`say sentence ${headline().kind}`} role="status">
        <strong>{headline().words}</strong> {props.found.sentence}
      </div>
      <div class="stack">
        <For each={props.found.effects}>{(one, place) => <Card finding={one} found={props.found} add={canAdd() ? () => void props.twin.add({ pick: place() + 1 }) : undefined} />}</For>
        <For each={props.found.sensor_or_timing}>{(one) => <Card finding={one} found={props.found} />}</For>
      </div>
      <Show when={props.found.effects.length > 1}>
        <div class="row"><button type="button" onClick={() => void props.twin.add({})}>Add all {props.found.effects.length} effects in one version</button></div>
      </Show>
      <Show when={props.found.sensor_or_timing.length > 0}>
        <p class="small">Faults of sensors and clocks are repaired in the log, not added to a model: read it again in step 2.</p>
      </Show>
      <Show when={["cannot-tell", "missing"].includes(props.found.verdict.kind) && candidatesOf(props.found).length > 1 && props.found.effects.some((one) => one.also_compatible.length > 0)}>
        <NextFlight twin={props.twin} found={props.found} />
      </Show>
      <Show when={props.found.proposal}>{(proposal) => <ProposalCard proposal={proposal()} add={() => void props.twin.add({ proposal: true })} />}</Show>
      <Truth twin={props.twin} />
      <Rest found={props.found} />
    </>
  );
}

function Card(props: { finding: Finding; found: Diagnosis; add?: (() => void) | undefined }) {
  const it = () => props.finding;
  const picture = () => it().picture ?? undefined;
  return (
    <article class="card found">
      <div class="row">
        <h3>{it().label}{it().instance.rotor ? `, rotor ${it().instance.rotor}` : ""}</h3>
        <span class="tag">{it().class}</span>
        <Show when={it().onset_s !== null}><span class="tag warn">sets in at {short(it().onset_s)} s</span></Show>
        <span class="grow" />
        <Show when={props.add}><button type="button" class="main" onClick={() => props.add?.()}>Add to the model<span class="sr">: {it().label}</span></button></Show>
      </div>
      <div class={picture() ? "side" : "stack"}>
        <div class="stack">
          <pre class="equation" tabindex="0" aria-label="equation">{it().equation}</pre>
          <dl class="facts">
            <For each={it().parameters}>
              {(one) => (
                <>
                  <dt>{one.symbol} <code class="small">{one.name}</code></dt>
                  <dd class="num">{plusMinus(one.value, one.interval_95, one.unit)} <Show when={!one.plausible}><span class="tag warn">outside the plausible range</span></Show></dd>
                </>
              )}
            </For>
            <dt>Evidence</dt>
            <dd>ln Bayes factor {short(it().ln_bayes_factor)}: {evidenceWords(it().ln_bayes_factor)} (above {props.found.threshold}: named); probability {percent(it().posterior)} among the catalogue</dd>
            <dt>Shows in</dt>
            <dd>{it().channels.map(channelTitle).join(", ")}</dd>
            <For each={props.found.held_out.filter((one) => Math.abs(one.after - one.before) > 0.02 * one.before)}>
              {(one) => (
                <>
                  <dt>Held-out {one.quantity}</dt>
                  <dd class="num">{milli(one.before)} → <strong>{milli(one.after)} m{one.unit}</strong> on blocks that the fit did not see</dd>
                </>
              )}
            </For>
          </dl>
          <p class="small muted">{it().reason}</p>
          <Rivals finding={it()} />
        </div>
        <Show when={picture()}>
          {(found) => (
            <Chart
              title={`Residual of ${channelTitle(found().channel)} before and after`}
              unit={found().unit}
              xLabel={found().regressor}
              xUnit={found().regressor_unit}
              x={found().bins.map((bin) => bin.at)}
              bands={[{ label: "95 % of noise alone", low: found().bins.map((bin) => -bin.band_95), high: found().bins.map((bin) => bin.band_95), colour: "s3" }]}
              lines={[
                { label: "before", values: found().bins.map((bin) => bin.before), colour: "s2", width: 2 },
                { label: "after", values: found().bins.map((bin) => bin.after), colour: "s1", width: 2 },
              ]}
              height={230}
            />
          )}
        </Show>
      </div>
    </article>
  );
}

const milli = (value: number) => short(1e3 * value);

function Rivals(props: { finding: Finding }) {
  return (
    <>
      <p class="small">
        {props.finding.also_compatible.length === 0
          ? "Also compatible: none."
          : `Also compatible: ${props.finding.also_compatible.map((one) => `${one.label} (ln Bayes factor ${short(one.evidence_gap)} against it)`).join(", ")}.`}
      </p>
      <Show when={props.finding.lost.length > 0}>
        <details>
          <summary>{props.finding.lost.length} rivals that lost</summary>
          <ul class="small"><For each={props.finding.lost}>{(one) => <li>{one.label}: {one.reason} (gap {short(one.evidence_gap)})</li>}</For></ul>
        </details>
      </Show>
    </>
  );
}

function ProposalCard(props: { proposal: Proposal; add: () => void }) {
  return (
    <article class="card found">
      <div class="row">
        <h3>Proposal: an effect of your own</h3>
        <span class="grow" />
        <Show when={props.proposal.document}><button type="button" class="main" onClick={props.add}>Add the proposal</button></Show>
      </div>
      <For each={props.proposal.terms} fallback={<p>No term of the motion explains the error on blocks that the fit did not see.</p>}>
        {(one) => (
          <div>
            <pre class="equation" tabindex="0" aria-label="term">{one.acts.join(", ")} · {one.parameter}</pre>
            <p class="num">{one.parameter} = {plusMinus(one.factor, 1.96 * one.deviation, one.unit)}; correlation {short(one.correlation)}; {percent(one.held_out_share, 0)} of the error is explained on unseen blocks up to here</p>
          </div>
        )}
      </For>
      <Show when={props.proposal.correlates.length > 0}>
        <p class="small muted">{props.proposal.correlates.map((one) => `${channelTitle(one.channel)} follows ${one.regressor} (correlation ${short(one.correlation)})`).join("; ")}.</p>
      </Show>
      <p class="small muted">Found by regression of a residual: a correlation with a dimension, not yet physics.</p>
    </article>
  );
}

interface TruthAnswer {
  effects: { id: string; rotor: number | null; onset_s: number | null; parameters: Record<string, number> }[];
  flight: string;
}

/** Of an example: what was hidden. */
function Truth(props: { twin: Twin }) {
  const [shown, setShown] = createSignal(false);
  const facts = () => (props.twin.log.job()?.facts ?? {}) as { example?: boolean };
  const truth = createLoad(
    () => (shown() ? props.twin.logs()[0] : undefined),
    (id, signal) => ask<TruthAnswer>("GET", `/api/v1/logs/${id}/truth`, undefined, { signal }),
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

function Rest(props: { found: Diagnosis }) {
  return (
    <details>
      <summary>Ranking of all candidates, what this flight cannot show, notes</summary>
      <div class="two">
        <div class="scroll" tabindex="0" role="region" aria-label="Ranking of the candidates">
          <table class="small">
            <thead><tr><th scope="col">Candidate alone</th><th class="r" scope="col">ln Bayes factor</th><th class="r" scope="col">held-out chi²</th></tr></thead>
            <tbody>
              <For each={props.found.ranking.slice(0, 15)}>{(one) => <tr><td>{one.label}</td><td class="r">{short(one.ln_bayes_factor)}</td><td class="r">{short(one.held_out_chi2_change)}</td></tr>}</For>
            </tbody>
          </table>
        </div>
        <div class="scroll" tabindex="0" role="region" aria-label="What this flight cannot show">
          <table class="small">
            <thead><tr><th scope="col">Not testable here</th><th class="r" scope="col">plausible size</th><th class="r" scope="col">seen from</th><th scope="col">excited by</th></tr></thead>
            <tbody>
              <For each={props.found.not_testable} fallback={<tr><td colspan="4" class="muted">nothing of the catalogue</td></tr>}>
                {(one) => <tr><td>{one.label}</td><td class="r">{short(one.plausible_size)} {one.unit}</td><td class="r">{short(one.minimum_size)}</td><td>{one.excited_by}</td></tr>}
              </For>
            </tbody>
          </table>
        </div>
      </div>
      <ul class="small"><For each={props.found.notes}>{(one) => <li>{one}</li>}</For></ul>
    </details>
  );
}
