/** Step 6: versions of the model, and how the error decreases from one to the next; undo, differences, export, next steps. */
import { For, Show, createSignal } from "solid-js";
import { get } from "../../api/client";
import { createLoad } from "../../api/load";
import { sentenceOf } from "../../api/problem";
import { moment, plusMinus, short } from "../../format";
import type { LogComparison } from "../../model/twin";
import { Problem } from "../../parts/bits";
import { Falls } from "../../plots/falls";
import { Step } from "./step";
import type { Twin } from "./state";

const MAIN_QUANTITIES = ["force", "torque", "voltage"];

export function Add(props: { twin: Twin }) {
  const line = () => props.twin.line();
  const [more, setMore] = createSignal(false);
  const [diff, setDiff] = createSignal(false);
  const isHead = () => props.twin.head()?.version === line().at(-1)?.version;
  const branches = () => props.twin.history.data()?.branches ?? [];
  // The selected version, as a submission names it.
  const shown = () => encodeURIComponent(branches().length === 1 && isHead() ? (props.twin.model() ?? "") : `${props.twin.model() ?? ""}@v${line().at(-1)?.version ?? 0}`);
  const difference = createLoad(
    () => (diff() && line().length > 1 ? { model: props.twin.model() ?? "", from: line()[0]?.version ?? 0, to: line().at(-1)?.version ?? 0 } : undefined),
    ({ model, from, to }, signal) => get("/api/v1/models/{name}/diff", { path: { name: model }, query: { from: `v${from}`, to: `v${to}` }, signal }),
  );
  const logs = () => props.twin.comparison.result()?.logs ?? [];
  const falls = (log: LogComparison) =>
    (log.models[0]?.errors ?? [])
      .filter((one) => more() || MAIN_QUANTITIES.includes(one.quantity))
      .map((one) => ({
        title: one.quantity,
        unit: one.unit,
        noise: one.noise ?? null,
        rows: log.models.map((model) => ({ name: model.model.replace(/^.*@/, ""), error: model.errors.find((other) => other.quantity === one.quantity)?.error ?? null })),
      }));
  const label = (place: number) => {
    const name = logs()[place]?.log.name ?? "";
    return `on ${name}${logs().length === 1 ? "" : place < Math.max(1, props.twin.logs().length) ? ", fitted" : ", held out"}`;
  };
  return (
    <Step
      number={6}
      title="Add it, and watch the error fall"
      later="one click makes the next version of the model, and the comparison runs again"
      state={!props.twin.ready() ? "waiting" : props.twin.problem() ? "problem" : logs().length > 0 ? "done" : "working"}
      note={line().length > 1 ? `${line().length - 1} added` : "nothing added yet: use “Add to the model” or “Add the proposal” above"}
      actions={
        <Show when={line().length > 1 && isHead()}>
          <button type="button" onClick={() => void props.twin.undo()}>Undo {line().at(-1)?.label.replace(/^.*@/, "")}</button>
        </Show>
      }
    >
      <Problem sentence={props.twin.problem()} retry={props.twin.again} />
      <For each={logs()}>
        {(log, place) => (
          <div class="stack">
            <h3>Error of each version {label(place())} <span class="small muted">root mean square of means over 0.1 s; the mark is what noise alone gives</span></h3>
            <div class="three"><For each={falls(log)}>{(one) => <Falls fall={one} />}</For></div>
          </div>
        )}
      </For>
      <div class="scroll" tabindex="0" role="region" aria-label="Versions of the model">
        <table class="small">
          <thead><tr><th scope="col">Version</th><th scope="col">Added</th><th scope="col">Parameters</th><th class="r" scope="col">ln Bayes factor</th><th scope="col">Made</th><th scope="col">Hash</th></tr></thead>
          <tbody>
            <For each={line()}>
              {(version) => {
                const added = () => version.effects.filter((one) => version.changed.includes(one.effect));
                return (
                  <tr>
                    <td><button type="button" class="plain" onClick={() => props.twin.chooseVersion(version.version)}>{version.label}</button></td>
                    <td>{added().map((one) => one.label).join(", ") || version.changed.join(", ") || (version.version === 0 ? "the vehicle as it is documented" : "")}</td>
                    <td class="num">{added().flatMap((one) => one.parameters.map((value) => `${value.name} = ${plusMinus(value.value, 1.96 * (value.deviation ?? 0), "")}`)).join("; ")}</td>
                    <td class="r">{added().map((one) => short(one.ln_bayes_factor)).join(", ")}</td>
                    <td class="num">{moment(version.made_ms)}</td>
                    <td class="mono">{version.hash.slice(0, 8)}</td>
                  </tr>
                );
              }}
            </For>
          </tbody>
        </table>
      </div>
      <Show when={!isHead() && line().length > 0 && props.twin.head()}>
        {(head) => (
          <div class="say">
            You look at {line().at(-1)?.label}; {head().name === "main" ? "the model" : `the branch ${head().name}`} is at v{head().version}.{" "}
            <button type="button" onClick={() => props.twin.chooseVersion(head().version)}>Go there</button>{" "}
            To continue from here instead, begin a branch.
          </div>
        )}
      </Show>
      <Show when={props.twin.model()}>
        <div class="row">
          <label class="check"><input type="checkbox" checked={more()} onChange={(event) => setMore(event.currentTarget.checked)} /> all quantities</label>
          <Branches twin={props.twin} />
          <Show when={line().length > 1}><button type="button" aria-expanded={diff()} onClick={() => setDiff(!diff())}>Differences to {line()[0]?.label}</button></Show>
          <a class="button" href={`/api/v1/models/${encodeURIComponent(props.twin.model() ?? "")}/versions/v${line().at(-1)?.version ?? 0}`} download={`${props.twin.model()}.toml`}>Export the version</a>
          <a class="button" href={`/runs?new=1&model=${shown()}`}>Fly this model</a>
          <a class="button" href={`/runs?new=1&model=${shown()}&fdi_model=${shown()}`}>Give it to the detectors</a>
        </div>
      </Show>
      <Problem sentence={difference.error()} retry={difference.reload} />
      <Show when={diff() && difference.data()}>
        {(found) => (
          <table class="small">
            <thead><tr><th scope="col">What</th><th class="r" scope="col">before</th><th class="r" scope="col">after</th></tr></thead>
            <tbody>
              <For each={found().parameters}>
                {(one) => (
                  <tr>
                    <td>{one.effect}: {one.parameter}</td>
                    <td class="r">{one.before ? plusMinus(one.before.value, 1.96 * (one.before.deviation ?? 0), "") : "–"}</td>
                    <td class="r">{one.after ? plusMinus(one.after.value, 1.96 * (one.after.deviation ?? 0), "") : "–"}</td>
                  </tr>
                )}
              </For>
              <For each={found().keys}>{(one) => <tr><td><code>{one.key}</code></td><td class="r">{one.before ?? "–"}</td><td class="r">{one.after ?? "–"}</td></tr>}</For>
            </tbody>
          </table>
        )}
      </Show>
    </Step>
  );
}

/** Choice of the branch to continue, and a new branch from the selected version. */
function Branches(props: { twin: Twin }) {
  const all = () => props.twin.history.data()?.branches ?? [];
  const free = () => {
    for (let k = 1; ; k += 1) if (!all().some((one) => one.name === `try-${k}`)) return `try-${k}`;
  };
  const [name, setName] = createSignal<string>();
  const [problem, setProblem] = createSignal<string>();
  const begin = async (event: SubmitEvent) => {
    event.preventDefault();
    setProblem(undefined);
    try {
      await props.twin.beginBranch((name() ?? "").trim());
      setName(undefined);
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };
  return (
    <>
      <Show when={all().length > 1}>
        <label class="row">
          Branch
          <select value={props.twin.branch()} onChange={(event) => props.twin.chooseBranch(event.currentTarget.value)}>
            <For each={all()}>{(one) => <option value={one.name} selected={one.name === props.twin.branch()}>{one.name} (v{one.version})</option>}</For>
          </select>
        </label>
      </Show>
      <button type="button" aria-expanded={name() !== undefined} onClick={() => setName(name() === undefined ? free() : undefined)}>Branch from {props.twin.line().at(-1)?.label.replace(/^.*@/, "")}</button>
      <Show when={name() !== undefined}>
        <form class="row" onSubmit={(event) => void begin(event)}>
          <label class="row">Name of the branch <input type="text" value={name()} maxLength={64} aria-invalid={problem() !== undefined} onInput={(event) => setName(event.currentTarget.value)} /></label>
          <button type="submit" class="main" disabled={!name()?.trim()}>Begin it</button>
        </form>
      </Show>
      <Problem sentence={problem()} />
    </>
  );
}
