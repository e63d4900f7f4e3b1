/** The library: effects with equations, vehicles with pictures, scenarios, blades and models as documents that can be edited. */
import { For, Show, createEffect, createMemo, createSignal, on, onCleanup } from "solid-js";
import { type Schemas, ask, get, putDocument, text as fetchText } from "../api/client";
import { createLoad } from "../api/load";
import { ApiError, sentenceOf } from "../api/problem";
import { percent, short } from "../format";
import { Figures, Loaded, Panel, Problem, Words } from "../parts/bits";
import { VehiclePicture } from "../parts/vehicle-picture";
import { Known } from "../shown/known";
import { route, setQuery } from "../router";
import { EffectSandbox } from "./effect-sandbox";
import type { FullGeometry } from "../replay/motion";
import { createTyped } from "../typed";

const KINDS = [
  ["effects", "Effects"], ["vehicles", "Vehicles"], ["scenarios", "Scenarios"], ["blades", "Blades"], ["models", "Models"],
] as const;
type Kind = (typeof KINDS)[number][0];
const TYPING_MS = 400;

export default function Library() {
  const kind = () => (KINDS.find(([one]) => one === route().query.get("kind"))?.[0] ?? "effects") as Kind;
  return (
    <>
      <div class="row">
        <h1>Library</h1>
        <div class="row" role="group" aria-label="kind of document">
          <For each={KINDS}>{([one, title]) => <button type="button" aria-pressed={kind() === one} onClick={() => setQuery({ kind: one, name: undefined, q: undefined })}>{title}</button>}</For>
        </div>
      </div>
      <Show when={kind() === "effects"} fallback={<Show when={kind()} keyed>{(one) => <Documents kind={one} />}</Show>}>
        {/* Few effects are documents: the catalogue is what is looked for. */}
        <details class="panel" open={route().query.has("name")}>
          <summary>Effects as documents: expressions that the server has, and yours</summary>
          <Documents kind="effects" />
        </details>
        <Catalogue />
      </Show>
    </>
  );
}

function Catalogue() {
  const catalogue = createLoad(() => true, async (_, signal) => (await get("/api/v1/catalogue", { signal })).items);
  const vehicles = createLoad(() => true, async (_, signal) => (await get("/api/v1/vehicles", { signal })).items);
  const wanted = () => (route().query.get("q") ?? "").toLowerCase();
  const shown = createMemo(() => (catalogue.data() ?? []).filter((one) => `${one.id} ${one.name} ${one.class} ${one.channels.join(" ")}`.toLowerCase().includes(wanted())));
  return (
    <Panel title="Effects that a model can have" note={`${shown().length} shown`} actions={<input type="search" placeholder="search" aria-label="search the effects" value={wanted()} onInput={(event) => setQuery({ q: event.currentTarget.value || undefined }, true)} />}>
      <Loaded load={catalogue} what="the catalogue">
        {() => (
          <div class="effects">
            <For each={shown()}>
              {(one) => (
                <article class="card" id={one.id}>
                  <div class="row"><h3>{one.name}</h3><span class="tag">{one.class}</span><Show when={one.per_rotor}><span class="tag">per rotor</span></Show></div>
                  <code class="small muted">{one.id}</code>
                  <pre class="equation" tabindex="0" aria-label="equation">{one.equation}</pre>
                  <div class="scroll" tabindex="0" role="region" aria-label={`Parameters of ${one.name}`}>
                    <table class="small">
                      <thead><tr><th scope="col">parameter</th><th scope="col">meaning</th><th class="r" scope="col">typical</th><th class="r" scope="col">plausible</th></tr></thead>
                      <tbody>
                        <For each={one.parameters}>
                          {(value) => <tr><td>{value.symbol} <code>{value.name}</code></td><td><Words text={value.meaning} /></td><td class="r">{short(value.typical)} {value.unit === "1" ? "" : value.unit}</td><td class="r">{short(value.plausible_low)} … {short(value.plausible_high)}</td></tr>}
                        </For>
                      </tbody>
                    </table>
                  </div>
                  <Show when={one.parameters.length > 0}><EffectSandbox effect={one} vehicles={vehicles.data() ?? ["f550"]} /></Show>
                  <p class="small muted">Acts on {one.channels.join(", ")}. Excited by <Words text={one.excited_by} />. <Show when={one.confused_with.length > 0}>Confused with {one.confused_with.join(", ")}. </Show>Source: <Words text={one.source} />.</p>
                </article>
              )}
            </For>
          </div>
        )}
      </Loaded>
    </Panel>
  );
}

function Documents(props: { kind: Kind }) {
  const names = createLoad(() => true, (_, signal) => ask<Schemas["Names"]>("GET", `/api/v1/${props.kind}`, undefined, { signal }));
  const name = () => route().query.get("name") ?? undefined;
  const [edition, setEdition] = createSignal(0);
  const saved = () => {
    names.reload();
    setEdition(edition() + 1);
  };
  return (
    <div class="side rev">
      <Panel title={`Documents: ${props.kind}`} note="your own documents hide the server's of the same name">
        <Loaded load={names} what="the names">
          {(found) => (
            <ul class="plain">
              <For each={found().items} fallback={<li class="muted">none</li>}>
                {(one) => (
                  <li><button type="button" class="plain" aria-pressed={one === name()} onClick={() => setQuery({ name: one })}>{one}</button> <Show when={found().own.includes(one)}><span class="tag">own</span></Show></li>
                )}
              </For>
            </ul>
          )}
        </Loaded>
      </Panel>
      <div class="stack">
        <Show when={name() !== undefined ? { kind: props.kind, name: name() as string } : undefined} keyed fallback={<p class="muted">Choose a document to read it or to edit a copy.</p>}>
          {(one) => (
            <>
              <Show when={props.kind === "vehicles"}><Picture name={one.name} edition={edition()} /></Show>
              <Editor kind={one.kind} name={one.name} own={names.data()?.own.includes(one.name) ?? false} onSaved={saved} />
            </>
          )}
        </Show>
      </div>
    </div>
  );
}

function Picture(props: { name: string; edition: number }) {
  const geometry = createLoad(() => ({ name: props.name, edition: props.edition }), ({ name }, signal) => ask<FullGeometry>("GET", `/api/v1/vehicles/${encodeURIComponent(name)}/geometry`, undefined, { signal }));
  return (
    <Panel title={props.name} note={geometry.data()?.name}>
      <Loaded load={geometry} what="the geometry">
        {(found) => (
          <div class="side">
            <Figures items={[["mass", `${short(found().mass_kg)} kg`], ["arm", `${short(found().arm_m)} m`], ["rotors", String(found().rotors.length)], ["hover thrust", `${short(found().hover?.thrust_n)} N`], ["hover duty", percent(found().hover?.duty[0], 0)]]} />
            <VehiclePicture geometry={found()} />
          </div>
        )}
      </Loaded>
      <details open>
        <summary>How well its values are known, with 95 % intervals</summary>
        <Known vehicle={props.name} edition={props.edition} />
      </details>
    </Panel>
  );
}

function Editor(props: { kind: Kind; name: string; own: boolean; onSaved: () => void }) {
  const document = createLoad(() => props.name, () => fetchText(`/api/v1/${props.kind}/${encodeURIComponent(props.name)}`));
  // What stands behind a mark was typed, also if that is nothing.
  const [typed, setTyped, forget] = createTyped(`document.${props.kind}.${props.name}`);
  const draft = createMemo(() => (typed() === "" ? undefined : typed().slice(1)));
  const setDraft = (text: string) => setTyped(`=${text}`);
  const discard = () => {
    setTyped("");
    forget();
    setCheck(undefined);
  };
  // Whose document it is, is known once the names have come.
  const [chosen, setTarget] = createSignal<string>();
  const target = () => chosen() ?? (props.own ? props.name : `my-${props.name}`);
  const [check, setCheck] = createSignal<Schemas["Validation"]>();
  const [refusal, setRefusal] = createSignal<ApiError>();
  const [said, setSaid] = createSignal("");
  const [saved, setSaved] = createSignal(props.name);
  createEffect(
    on(draft, (text) => {
      setSaid("");
      if (text === undefined) return;
      const timer = setTimeout(() => {
        ask<Schemas["Validation"]>("POST", `/api/v1/${props.kind}/validate`, { text }).then(setCheck, (error: unknown) =>
          setCheck({ valid: false, refusal: sentenceOf(error), complaints: [], warnings: [] }),
        );
      }, TYPING_MS);
      onCleanup(() => clearTimeout(timer));
    }),
  );
  const save = async () => {
    setRefusal(undefined);
    try {
      await putDocument(`/api/v1/${props.kind}/${encodeURIComponent(target())}`, draft() ?? document.data() ?? "");
      forget();
      setSaid(`Saved as ${target()}.`);
      setSaved(target());
      props.onSaved();
    } catch (error) {
      setRefusal(error instanceof ApiError ? error : new ApiError(0, sentenceOf(error)));
    }
  };
  return (
    <Panel title={`${props.name}.toml`} note={props.own ? "your own" : "the server's: saved under a name of your own"}>
      <Loaded load={document} what="the document">
        {(found) => (
          <div class="stack">
            <textarea rows="24" spellcheck={false} aria-label={`text of ${props.name}`} aria-invalid={check()?.valid === false} value={draft() ?? found()} onInput={(event) => setDraft(event.currentTarget.value)} />
            <div aria-live="polite">
              <Show when={check()?.valid === false}>
                <div class="say bad">
                  <Show when={(check()?.complaints.length ?? 0) > 0} fallback={check()?.refusal}>
                    <ul class="plain"><For each={check()?.complaints}>{(one) => <li><Show when={one.line}>line {one.line}: </Show><Show when={one.key}><code>{one.key}</code>: </Show>{one.sentence}</li>}</For></ul>
                  </Show>
                </div>
              </Show>
              <For each={check()?.warnings ?? []}>{(one) => <div class="say warn">{one}</div>}</For>
            </div>
            <Problem sentence={refusal()?.sentence} complaints={refusal()?.complaints} />
            <div class="fields">
              <label class="field">Save as<input type="text" value={target()} onInput={(event) => setTarget(event.currentTarget.value.trim())} /></label>
              <button type="button" class="main" disabled={check()?.valid === false || !target()} onClick={() => void save()}>Save</button>
              <Show when={draft() !== undefined}><button type="button" onClick={discard}>Back to what is saved</button></Show>
              <Show when={props.kind === "scenarios"}><a class="button" href={`/runs?new=1&scenario=${encodeURIComponent(saved())}`}>Fly {saved()}</a></Show>
              <span role="status" class="small muted">{said() || (check()?.valid && draft() !== undefined ? "The document is valid." : "")}</span>
            </div>
          </div>
        )}
      </Loaded>
    </Panel>
  );
}
