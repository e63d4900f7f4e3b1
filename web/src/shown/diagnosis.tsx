/** A diagnosis: missing effects. "Agrees", "the log is at fault", "cannot tell" and "not in the catalogue" are complete answers. */
import { For, type JSX, Show } from "solid-js";
import { count, percent, plusMinus, short } from "../format";
import { type Comparison, type Correction, type Diagnosis, type Finding, type Proposal, channelTitle, evidenceWords, remainderOf, togetherByReason } from "../model/twin";
import { adviceText } from "../model/identify";
import { Words } from "../parts/bits";
import { Chart } from "../plots/chart";

const HEADLINES: Record<Diagnosis["verdict"]["kind"], { words: string; kind: string }> = {
  agrees: { words: "The model agrees with the flight.", kind: "good" },
  missing: { words: "Physics is missing, and named.", kind: "warn" },
  "cannot-tell": { words: "Physics is missing, and this flight cannot tell which of these.", kind: "warn" },
  "partly-missing": { words: "Physics is missing, and named; it explains a part of the error, the rest is not in the catalogue.", kind: "warn" },
  "calibrate-first": { words: "Constants of this vehicle are guesses that the flight contradicts: calibrate it first.", kind: "warn" },
  "outside-catalogue": { words: "Nothing in the catalogue of effects explains all of the error.", kind: "warn" },
  "flights-differ": { words: "These flights differ: no single model explains all of them.", kind: "warn" },
  "log-fault": { words: "The log is at fault; the physics agrees.", kind: "bad" },
  "nothing-testable": { words: "Nothing of this log can be compared with the model.", kind: "bad" },
};

/** Nothing of the catalogue is missing, and yet a channel is not at its noise. */
const UNEXPLAINED = { words: "No effect of the catalogue is needed, and none explains more.", kind: "warn" };

/** What follows [`UNEXPLAINED`]: the remainder, and where the diagnosis finds that small errors of other constants make it. */
function unexplained(found: Diagnosis, remainder: string): string {
  const small = / at a size that would show\.?(.*)$/s.exec(found.sentence)?.[1] ?? "";
  return `The comparison still sees a remainder${small === "" ? ", which no effect explains" : ""}: ${remainder}.${small}`;
}

/** The sentence without the part that the headline already says. */
function restOf(found: Diagnosis, onPage: boolean): string {
  let rest = found.sentence.replace(/^The model agrees with (this|the) flights?: /, "").replace(/ Each flight has a wind of its own: .*$/, "").replace(/^These flights differ: nothing explains them together, but each alone is explained\. /, "");
  // The page has a button for what a report names a command for, and fields for its options.
  if (onPage) rest = adviceText(rest.replace(/^Calibrate first \(`rotortwin [^)]*\): /, ""));
  // The headline has said it.
  if (found.verdict.kind === "nothing-testable" && HEADLINES["nothing-testable"].words.startsWith(rest.replace(/ [^ ]*\.?$/, ""))) return "What is missing in it, and what that rules out, is listed where it is read.";
  return rest.charAt(0).toUpperCase() + rest.slice(1);
}

/** Adds a finding (its number from 1), all of them, or the proposal to the model. */
export type AddToModel = (what: { pick?: number; proposal?: true }) => void;

/** What a page can do about constants that are wrong. */
export interface Calibrating {
  /** Takes values estimated from the flight into the model. */
  take: (corrections: readonly Correction[]) => void;
  /** Opens the form that makes a vehicle from the flight. */
  fromLog: (() => void) | undefined;
}

/** `compared`: a comparison, perhaps of the same model and flights; then the two are shown to say one thing. */
export function DiagnosisView(props: { found: Diagnosis; compared?: Comparison | undefined; add?: AddToModel; calibrating?: Calibrating; children?: JSX.Element }) {
  const remainder = () => remainderOf(props.found, props.compared);
  const headline = () => (remainder() === undefined ? HEADLINES[props.found.verdict.kind] : UNEXPLAINED);
  const following = () => {
    const left = remainder();
    return left === undefined ? restOf(props.found, props.calibrating !== undefined) : unexplained(props.found, left);
  };
  const add = () => (props.found.verdict.kind !== "agrees" ? props.add : undefined);
  // While the rest is unexplained, no effect of the catalogue is to be trusted: the proposal comes first.
  const isOutside = () => props.found.verdict.kind === "outside-catalogue";
  const proposal = () => <Show when={props.found.proposal}>{(one) => <ProposalCard proposal={one()} add={props.add && (() => props.add?.({ proposal: true }))} />}</Show>;
  return (
    <>
      <Show when={props.found.trim}>{(trim) => <TrimView trim={trim()} />}</Show>
      <div class={`say sentence ${headline().kind}`} role="status">
        <strong>{headline().words}</strong> <Words text={following()} />
      </div>
      <Show when={isOutside()}>{proposal()}</Show>
      <div class="stack">
        <For each={props.found.effects}>
          {(one, place) => <Card finding={one} found={props.found} isDoubtful={isOutside()} add={add() ? () => add()?.({ pick: place() + 1 }) : undefined} />}
        </For>
        <For each={props.found.sensor_or_timing}>{(one) => <Card finding={one} found={props.found} />}</For>
      </div>
      <For each={props.found.apart ?? []}>{(one) => <Apart flights={one} found={props.found} />}</For>
      <Show when={(props.found.winds ?? []).length > 0}><Winds found={props.found} add={add() && props.found.verdict.kind === "missing" && props.found.effects.length === 0 ? () => add()?.({}) : undefined} /></Show>
      <Show when={props.found.effects.length > 1 && add()}>
        {(all) => <div class="row"><button type="button" onClick={() => all()({})}>Add all {props.found.effects.length} effects in one version</button></div>}
      </Show>
      <Show when={props.found.sensor_or_timing.length > 0}>
        <p class="small">Faults of sensors and clocks are repaired in the log, not added to a model.</p>
      </Show>
      <Show when={(props.found.calibrate ?? []).length > 0}><Calibrate found={props.found} calibrating={props.calibrating} /></Show>
      {props.children}
      <Show when={!isOutside()}>{proposal()}</Show>
      <Show when={(props.found.remainder ?? []).length > 0}><LeftOver remainder={props.found.remainder ?? []} /></Show>
      <NotConsidered found={props.found} />
      <Rest found={props.found} />
    </>
  );
}

/** What some of the flights have and the others have not. */
function Apart(props: { flights: NonNullable<Diagnosis["apart"]>[number]; found: Diagnosis }) {
  // Of these flights alone: their errors on held-out blocks.
  const found = (): Diagnosis => ({ ...props.found, held_out: props.flights.held_out });
  return (
    <section class="stack" aria-label={`Alone: ${props.flights.logs.join(", ")}`}>
      <h3>{props.flights.logs.join(", ")}</h3>
      <Show when={props.flights.effects.length + props.flights.sensor_or_timing.length > 0} fallback={<p><Words text={props.flights.sentence} /></p>}>
        <For each={[...props.flights.effects, ...props.flights.sensor_or_timing]}>{(one) => <Card finding={one} found={found()} />}</For>
        <p class="small">To add it to a model, diagnose these flights without the others.</p>
      </Show>
    </section>
  );
}

/** The wind of each flight; what is added to the model fits one to every flight from then on. */
function Winds(props: { found: Diagnosis; add?: () => void }) {
  return (
    <article class="card found" aria-label="The wind of each flight">
      <h3>Each flight has a wind of its own</h3>
      <div class="scroll" tabindex="0" role="region" aria-label="Winds">
        <table class="small">
          <thead><tr><th scope="col">Flight</th><th scope="col">Where the air moves to, with 95 % intervals</th></tr></thead>
          <tbody>
            <For each={props.found.winds ?? []}>
              {(one) => (
                <tr>
                  <td>{one.log}</td>
                  <td>{one.parameters.map((p) => `${p.symbol} = ${plusMinus(p.value, p.interval_95, p.unit)}`).join(", ")}{one.distinguished ? "" : ", or sensors that are off in this flight alone: it turns too little to tell"}</td>
                </tr>
              )}
            </For>
          </tbody>
        </table>
      </div>
      <p class="small">A model with this fits the wind of every flight, as it fits its charge; no wind becomes part of the vehicle.</p>
      <Show when={props.add}>{(add) => <button type="button" class="main" onClick={() => add()()}>Add to the model<span class="sr">: the wind of each flight</span></button>}</Show>
    </article>
  );
}

/** Effects that could not be considered, and what would make them testable. */
function NotConsidered(props: { found: Diagnosis }) {
  const rows = () => togetherByReason(props.found.not_considered ?? []);
  return (
    <Show when={rows().length > 0}>
      <details class="whole">
        <summary>{count(props.found.not_considered.length, "effect")} of the catalogue could not be considered</summary>
        <div class="scroll" tabindex="0" role="region" aria-label="What could not be considered">
          <table class="small">
            <thead><tr><th scope="col">Not considered</th><th scope="col">why</th><th scope="col">what would make it testable</th></tr></thead>
            <tbody>
              <For each={rows()}>
                {(row) => (
                  <tr>
                    <td>{row.labels.join(", ")}</td>
                    <td><Words text={row.reason} /></td>
                    <td>
                      <Show when={row.columns.length > 0} fallback={<Words text={row.setting ?? "–"} />}>
                        {row.columns.length > 1 ? "columns of the log " : "column of the log "}<code class="break">{row.columns.join(", ")}</code>
                      </Show>
                    </td>
                  </tr>
                )}
              </For>
            </tbody>
          </table>
        </div>
      </details>
    </Show>
  );
}

/** Changes compared with healthy flights. */
function TrimView(props: { trim: NonNullable<Diagnosis["trim"]> }) {
  return (
    <div class="say">
      <strong>Against the healthy flights:</strong> {props.trim.sentence} Thrust command of the rotors over the healthy mean:{" "}
      <span class="num">{props.trim.thrust_change.map((one) => percent(one)).join(", ")}</span>; healthy flights vary by {percent(props.trim.spread[0])} in common and{" "}
      {percent(props.trim.spread[1])} rotor by rotor;{" "}
      {typeof props.trim.smallest_loss !== "number" ? "no loss of one rotor up to 60 % would be named." : `a loss of ${percent(props.trim.smallest_loss, 0)} of one rotor would be named.`}
      <For each={props.trim.with_more.filter((more) => more.smallest_loss != null)}>
        {(more) => ` With ${more.flights} healthy flights: ${percent(more.smallest_loss ?? 0, 0)}.`}
      </For>
      <Show when={props.trim.vibration?.sentence ?? props.trim.no_vibration}>
        {(sentence) => (
          <>
            <br />
            <strong>Vibration:</strong> {sentence()}
          </>
        )}
      </Show>
    </div>
  );
}

/** Guessed values of the vehicle that the flights contradict. */
function Calibrate(props: { found: Diagnosis; calibrating: Calibrating | undefined }) {
  const constants = () => props.found.calibrate ?? [];
  const corrections = () => constants().map((one) => one.correction);
  return (
    <div class="stack">
    <Show when={props.calibrating}>
      {(calibrating) => (
        <div class="row">
          <Show when={corrections().length > 0}>
            <button type="button" class="main" onClick={() => calibrating().take(corrections())}>
              Take {corrections().length === 1 ? "the value" : `the ${corrections().length} values`} estimated from the flight
            </button>
          </Show>
          <Show when={calibrating().fromLog}>{(open) => <button type="button" onClick={() => open()()}>Make the vehicle from this flight</button>}</Show>
          <span class="small muted">It becomes the next version of the model, and everything is compared again; Undo takes it back.</span>
        </div>
      )}
    </Show>
    <div class="scroll" tabindex="0" role="region" aria-label="Constants to calibrate">
      <table class="small">
        <thead><tr><th scope="col">To calibrate</th><th class="r" scope="col">as guessed</th><th class="r" scope="col">from the flights</th><th class="r" scope="col">ln Bayes factor</th><th scope="col">guessed from</th><th scope="col">better</th></tr></thead>
        <tbody>
          <For each={constants()}>
            {(one) => (
              <tr>
                <td>{one.name} <code class="small">{one.key}</code></td>
                <td class="r">{short(one.value)} {one.unit} [{short(one.low)}, {short(one.high)}]</td>
                <td class="r">{plusMinus(one.wanted, one.wanted_interval_95, one.unit)}</td>
                <td class="r">{short(one.ln_bayes_factor)}</td>
                <td><Words text={one.how} /></td>
                <td><Words text={props.calibrating ? adviceText(one.better) : one.better} /></td>
              </tr>
            )}
          </For>
        </tbody>
      </table>
    </div>
    </div>
  );
}

function Card(props: { finding: Finding; found: Diagnosis; isDoubtful?: boolean; add?: (() => void) | undefined }) {
  const it = () => props.finding;
  const picture = () => it().picture ?? undefined;
  return (
    <article class="card found">
      <div class="row">
        <h3>{it().label}{it().instance.rotor && !it().label.includes(`rotor ${it().instance.rotor}`) ? `, rotor ${it().instance.rotor}` : ""}</h3>
        <span class="tag">{it().class}</span>
        <Show when={props.isDoubtful}><span class="tag warn">looks like it</span></Show>
        <Show when={typeof it().onset_s === "number"}><span class="tag warn">sets in at {short(it().onset_s)} s</span></Show>
        <span class="grow" />
        <Show when={props.add}><button type="button" class={props.isDoubtful ? "" : "main"} onClick={() => props.add?.()}>Add to the model<span class="sr">: {it().label}</span></button></Show>
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
            <Show when={it().channels.length > 0}>
              <dt>Shows in</dt>
              <dd>{it().channels.map(channelTitle).join(", ")}</dd>
            </Show>
            <For each={props.found.held_out.filter(hasChanged)}>
              {(one) => (
                <>
                  <dt>Held-out {one.quantity}</dt>
                  <dd class="num">{milli(one.before)} → <strong>{milli(one.after)} m{one.unit}</strong> on blocks that the fit did not see; noise alone {milli(one.noise)} m{one.unit}</dd>
                </>
              )}
            </For>
          </dl>
          <p class="small muted"><Words text={it().reason} /><Show when={props.isDoubtful}>. Not to be trusted while the rest is unexplained.</Show></p>
          <Rivals finding={it()} />
        </div>
        <Show when={picture()}>
          {(found) => (
            <Chart
              title={`Residual of ${channelTitle(found().channel)} before and after`}
              unit={found().unit}
              xLabel="contribution of the effect"
              xUnit={found().unit}
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

const milli = (value: number | null | undefined) => short(typeof value === "number" ? 1e3 * value : value);
const hasChanged = ({ before, after }: Diagnosis["held_out"][number]) => typeof before === "number" && typeof after === "number" && Math.abs(after - before) > 0.02 * before;

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

function ProposalCard(props: { proposal: Proposal; add: (() => void) | undefined }) {
  return (
    <article class="card found">
      <div class="row">
        <h3>Proposal: an effect of your own</h3>
        <span class="grow" />
        <Show when={props.proposal.document && props.add}><button type="button" class="main" onClick={() => props.add?.()}>Add the proposal</button></Show>
      </div>
      <For each={props.proposal.terms} fallback={<p>No term of the motion explains the error on blocks that the fit did not see.</p>}>
        {(one) => (
          <div>
            <pre class="equation" tabindex="0" aria-label="term">{one.acts.join(", ")} · {one.parameter}</pre>
            <p class="num">{one.parameter} = {plusMinus(one.factor, 1.96 * (one.deviation ?? 0), one.unit)}; correlation {short(one.correlation)}; {percent(one.held_out_share, 0)} of the error is explained on unseen blocks up to here</p>
          </div>
        )}
      </For>
      <Show when={props.proposal.correlates.length > 0}>
        <p class="small muted">{followWords(props.proposal.correlates)}</p>
      </Show>
      <p class="small muted">
        Found by regression of a residual: a correlation with a dimension, not yet physics.
        <Show when={props.proposal.terms.some((term) => term.acts.some((act) => /\btime\b/.test(act)))}> It is a function of this log's clock: a description of this flight, which predicts no other.</Show>
      </p>
    </article>
  );
}

/** What stays unexplained, channel by channel. */
function LeftOver(props: { remainder: NonNullable<Diagnosis["remainder"]> }) {
  return (
    <article class="card">
      <h3>Left over</h3>
      <ul class="small"><For each={props.remainder}>{(one) => <li><Words text={one.sentence} />.</li>}</For></ul>
      <p class="small muted">One half of the flight chose what is said here; the other half confirmed it and has these sizes.</p>
    </article>
  );
}

/** What residuals follow most: channels with one regressor together. */
function followWords(correlates: Proposal["correlates"]): string {
  const found = new Map<string, string[]>();
  for (const one of correlates) found.set(one.regressor, [...(found.get(one.regressor) ?? []), `${channelTitle(one.channel)} (correlation ${short(one.correlation)})`]);
  return [...found].map(([regressor, channels]) => `${channels.join(", ")} ${channels.length === 1 ? "follows" : "follow"} ${regressor}.`).join(" ");
}

type Ranked = Diagnosis["ranking"][number];

/** The linear fit may ask for a size that no vehicle has. */
const canBe = (one: Ranked): boolean => one.parameters.every((parameter) => parameter.plausible);

function Rest(props: { found: Diagnosis }) {
  return (
    <details class="whole">
      <summary>Ranking of all candidates, what this flight cannot show, notes</summary>
      <div class="two">
        <div class="scroll" tabindex="0" role="region" aria-label="Ranking of the candidates">
          <table class="small">
            <thead><tr><th scope="col">Candidate alone</th><th class="r" scope="col">ln Bayes factor</th><th class="r" scope="col">held-out chi²</th></tr></thead>
            <tbody>
              <For each={props.found.ranking.slice(0, 15)}>{(one) => <tr><td>{one.label}{canBe(one) ? "" : " (impossible size)"}</td><td class="r">{short(one.ln_bayes_factor)}</td><td class="r">{short(one.held_out_chi2_change)}</td></tr>}</For>
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
      <ul class="small">
        <Show when={props.found.goodness.unexplained.length > 0}><li>Unexplained: {props.found.goodness.unexplained.join(", ")}.</li></Show>
        <For each={props.found.notes}>{(one) => <li><Words text={one} /></li>}</For>
        <li>
          Assumed: the model is right to (95 %): {props.found.assumed}; everything else to 4 % of its plausible size. A file of intervals beside the vehicle (<code>rotortwin vehicle tolerances</code>)
          states other values. An effect is named above a ln Bayes factor of {short(props.found.threshold, 2)}.
        </li>
      </ul>
    </details>
  );
}
