/** The form of a new run: checked by the server during typing; also shown as curl, Python and command line. */
import { For, Show, createEffect, createMemo, createSignal, onCleanup } from "solid-js";
import { type Schemas, ask, get, post } from "../api/client";
import { createLoad } from "../api/load";
import { ApiError, sentenceOf } from "../api/problem";
import { jsonWithSeed } from "../exact";
import { type Wish, asCommand, asCurl, asPython, submissionOf } from "../model/commands";
import { Copy, Panel, Problem } from "../parts/bits";
import { navigate, route } from "../router";
import { createTyped } from "../typed";

/** Delay of the check after the last keystroke. */
const TYPING_MS = 350;

export function NewRun(props: { onSubmitted: () => void }) {
  const names = createLoad(() => true, async (_, signal) => {
    const [scenarios, vehicles, blades, models, autopilots, session] = await Promise.all([
      get("/api/v1/scenarios", { signal }),
      get("/api/v1/vehicles", { signal }),
      get("/api/v1/blades", { signal }),
      get("/api/v1/models", { signal }),
      get("/api/v1/autopilots", { signal }),
      get("/api/v1/session", { signal }),
    ]);
    return { scenarios: scenarios.items, own: scenarios.own, parts: vehicles.own.length + blades.own.length, models: models.items, autopilots: autopilots.items, token: session.needs_token };
  });
  const [scenario, setScenario] = createSignal(route().query.get("scenario") ?? "reference-flight");
  const [seed, setSeed, forgetSeed] = createTyped("run.seed");
  const [set, setSet, forgetSet] = createTyped("run.set");
  const [pace, setPace] = createSignal<Wish["pace"]>("fast");
  const [link, setLink] = createSignal<Wish["link"]>("in-process");
  const [autopilot, setAutopilot] = createSignal("");
  const [model, setModel] = createSignal(route().query.get("model") ?? "");
  const [fdiModel, setFdiModel] = createSignal(route().query.get("fdi_model") ?? "");
  const [check, setCheck] = createSignal<Schemas["Validation"]>();
  const [checking, setChecking] = createSignal(false);
  const [refusal, setRefusal] = createSignal<ApiError>();
  const [sending, setSending] = createSignal(false);

  const seedWrong = () => (seed() === "" || /^\d+$/.test(seed()) ? undefined : `Seed: '${seed()}' is no whole number from 0.`);
  const wish = createMemo<Wish>(() => ({
    scenario: scenario(),
    seed: seed() === "" || seedWrong() ? undefined : seed(),
    set: set().split("\n").map((line) => line.trim()).filter(Boolean),
    pace: pace(),
    link: link(),
    model: model() || undefined,
    fdiModel: fdiModel() || undefined,
    autopilot: autopilot() || undefined,
    // A vehicle or blade of one's own may hide the one that a scenario of the program names.
    own: names.data()?.own.includes(scenario()) || (names.data()?.parts ?? 0) > 0,
    token: names.data()?.token,
  }));

  let control: AbortController | undefined;
  createEffect(() => {
    const { scenario: name, set: changes } = wish();
    control?.abort();
    const mine = new AbortController();
    control = mine;
    const timer = setTimeout(() => {
      setChecking(true);
      post("/api/v1/scenarios/validate", { scenario: name, set: [...changes] }, { signal: mine.signal })
        .then(setCheck, (error: unknown) => {
          if (!mine.signal.aborted) setCheck({ valid: false, refusal: sentenceOf(error), complaints: [], warnings: [] });
        })
        .finally(() => mine.signal.aborted || setChecking(false));
    }, TYPING_MS);
    onCleanup(() => clearTimeout(timer));
  });
  onCleanup(() => control?.abort());

  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    setRefusal(undefined);
    setSending(true);
    try {
      const run = await ask<Schemas["Run"]>("POST", "/api/v1/runs", jsonWithSeed(submissionOf(wish())));
      forgetSeed();
      forgetSet();
      props.onSubmitted();
      navigate(`/runs/${run.id}`);
    } catch (error) {
      setRefusal(error instanceof ApiError ? error : new ApiError(0, sentenceOf(error)));
    } finally {
      setSending(false);
    }
  };

  const complaints = () => check()?.complaints ?? [];
  return (
    <Panel title="New run" note="checked by the server as you type">
      <form class="stack" onSubmit={(event) => void submit(event)}>
        <Problem sentence={names.error()} retry={names.reload} />
        <div class="fields">
          <label class="field">
            Scenario
            <select value={scenario()} onChange={(event) => setScenario(event.currentTarget.value)}>
              <For each={names.data()?.scenarios ?? [scenario()]}>{(name) => <option value={name} selected={name === scenario()}>{name}</option>}</For>
            </select>
          </label>
          <label class="field">
            Seed
            <input type="text" inputmode="numeric" size="10" placeholder="scenario's" value={seed()} aria-invalid={seedWrong() !== undefined} onInput={(event) => setSeed(event.currentTarget.value.trim())} />
          </label>
          <Show when={(names.data()?.autopilots.length ?? 0) > 0}>
            <label class="field">
              Controller
              <select value={autopilot()} onChange={(event) => setAutopilot(event.currentTarget.value)}>
                <option value="">our own</option>
                <For each={names.data()?.autopilots}>
                  {(one) => <option value={one.name} selected={one.name === autopilot()}>{`${one.name} (${one.kind}, ${one.state}${one.lockstep ? "" : ", not lockstep"})`}</option>}
                </For>
              </select>
            </label>
          </Show>
          <label class="field">
            Pace
            <select value={pace()} disabled={autopilot() !== ""} onChange={(event) => setPace(event.currentTarget.value as Wish["pace"])}>
              <option value="fast">as fast as possible</option>
              <option value="real-time">real time (400 Hz of wall clock)</option>
            </select>
          </label>
          <label class="field">
            Link
            <select value={link()} disabled={autopilot() !== ""} onChange={(event) => setLink(event.currentTarget.value as Wish["link"])}>
              <option value="in-process">in one process</option>
              <option value="iceoryx2">iceoryx2 (three processes)</option>
              <option value="zenoh">zenoh (three processes)</option>
            </select>
          </label>
          <label class="field">
            Model
            <select value={model()} onChange={(event) => setModel(event.currentTarget.value)}>
              <option value="">the scenario's vehicle</option>
              <For each={withLinked(names.data()?.models, model())}>{(name) => <option value={name} selected={name === model()}>{name}</option>}</For>
            </select>
          </label>
          <label class="field">
            The detectors assume
            <select value={fdiModel()} onChange={(event) => setFdiModel(event.currentTarget.value)}>
              <option value="">the scenario's vehicle</option>
              <For each={withLinked(names.data()?.models, fdiModel())}>{(name) => <option value={name} selected={name === fdiModel()}>{name}</option>}</For>
            </select>
          </label>
        </div>
        <label class="field">
          <span>Settings, one <code>key=value</code> a line</span>
          <textarea rows="3" spellcheck={false} placeholder="initial.state_of_charge=0.6" value={set()} aria-invalid={check()?.valid === false} onInput={(event) => setSet(event.currentTarget.value)} />
        </label>
        <Problem sentence={seedWrong()} />
        <div aria-live="polite" class="stack">
          <Show when={check()?.valid === false}>
            <div class="say bad">
              <Show when={complaints().length > 0} fallback={check()?.refusal}>
                <ul class="plain">
                  <For each={complaints()}>
                    {(one) => <li><Show when={one.line}>line {one.line}: </Show><Show when={one.key}><code>{one.key}</code>: </Show>{one.sentence}</li>}
                  </For>
                </ul>
              </Show>
            </div>
          </Show>
          <For each={check()?.valid ? (check()?.warnings ?? []) : []}>{(warning) => <div class="say warn">{warning}</div>}</For>
        </div>
        <Problem sentence={refusal()?.sentence} complaints={refusal()?.complaints} />
        <div class="row">
          <button type="submit" class="main" disabled={sending() || check()?.valid === false || seedWrong() !== undefined}>{sending() ? "Submitting …" : "Fly"}</button>
          <span class="muted small">{checking() ? "checking …" : check()?.valid && !refusal() ? "The scenario is valid." : ""}</span>
          <span class="grow" />
          <Copy label="Copy as curl" text={() => asCurl(wish(), location.origin)} />
          <Copy label="Python" text={() => asPython(wish(), location.origin)} />
          <Copy label="CLI" text={() => asCommand(wish(), location.origin)} />
        </div>
        <details>
          <summary>The same as text, and every setting in effect</summary>
          <pre tabindex="0" aria-label="curl">{asCurl(wish(), location.origin)}</pre>
          <pre tabindex="0" aria-label="Python">{asPython(wish(), location.origin)}</pre>
          <pre tabindex="0" aria-label="command line">{asCommand(wish(), location.origin)}</pre>
          <Show when={check()?.effective}>
            <h3>Every setting in effect</h3>
            <pre tabindex="0" aria-label="settings in effect">{check()?.effective}</pre>
          </Show>
        </details>
      </form>
    </Panel>
  );
}

/** The names, and `NAME@v1` if a link contained it. */
function withLinked(names: readonly string[] | undefined, linked: string): readonly string[] {
  const all = names ?? [];
  return linked.includes("@") && !all.includes(linked) ? [...all, linked] : all;
}
