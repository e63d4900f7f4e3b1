/** In step 3: a custom vehicle from the flight, mass and arm; each value with its interval and source; stored under a name. */
import { For, Show, createEffect, createMemo, createSignal, on } from "solid-js";
import { createAttempt } from "../../api/attempt";
import { type Schemas, ask, freshKey } from "../../api/client";
import { type JobView, createJob } from "../../api/job";
import { count, short } from "../../format";
import { type BenchTable, benchNotes, benchTable, shapeOf, tablesOf, tooMuch, withoutPlace } from "../../model/bench";
import { type Identification, FRAMES, answerOf, failsOn, inOrder, nameFrom, nameProblem, numberOf, rotorsOf, sourceOf } from "../../model/identify";
import { Problem } from "../../parts/bits";
import { JobProgress } from "../../parts/job";
import { VehiclePicture } from "../../parts/vehicle-picture";
import { Advice, HeldOut, ValueTable } from "../../shown/identified";
import { createTyped } from "../../typed";
import type { Twin } from "./state";

/** Known dimension: the arm, or the nominal frame size. */
const LENGTHS = [
  { key: "arm-m", label: "Arm, m (centre to the furthest rotor)", unit: "m", toArm: (value: number) => value },
  { key: "diagonal-mm", label: "Frame size, mm (motor to opposite motor)", unit: "mm", toArm: (value: number) => value / 2000 },
] as const;

export function FromLog(props: { twin: Twin; taken: readonly string[]; onKept: () => void }) {
  const job = createJob<Identification>("identifications", () => props.twin.identification());
  const [mass, setMass] = createTyped("vehicle.mass");
  const [length, setLength] = createTyped("vehicle.length");
  const [measure, setMeasure] = createTyped("vehicle.measure", LENGTHS[0].key);
  const [frame, setFrame] = createTyped("vehicle.frame");
  const [cells, setCells] = createTyped("vehicle.cells");
  const [capacity, setCapacity] = createTyped("vehicle.capacity");
  const [halves, setHalves] = createTyped("vehicle.halves");
  const [typedName, setName] = createTyped("vehicle.name");
  const [bench, setBench] = createTyped("vehicle.bench");
  const tables = createMemo(() => tablesOf(bench()));
  const { busy, problem, setProblem, attempt } = createAttempt();

  const way = () => LENGTHS.find((one) => one.key === measure()) ?? LENGTHS[0];
  const name = () => typedName().trim() || nameFrom(props.twin.log.job()?.name ?? "mine");
  /** An optional number: empty is valid. */
  const optional = (text: string, what: string, unit: string) => (text.trim() === "" ? {} : numberOf(text, what, unit));
  const numbers = () => ({
    mass: numberOf(mass(), "Mass", "kg"), length: numberOf(length(), way().label.split(",")[0] ?? "", way().unit),
    cells: optional(cells(), "Cells", "in series"), capacity: optional(capacity(), "Capacity", "A h"),
  });
  const wrong = () => Object.values(numbers()).map((one) => one.problem).concat(nameProblem(name()), tooMuch(tables())).filter((one) => one !== undefined);
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const { mass: kg, length: reach, cells: series, capacity: charge } = numbers();
    setProblem(wrong().join(" ") || undefined);
    if (kg.value === undefined || reach.value === undefined || wrong().length > 0) return;
    const [heavy, wide] = [kg.value, reach.value];
    await attempt(async () => {
      const made = await ask<JobView>("POST", "/api/v1/identifications", {
        name: name(), flights: props.twin.flights(), mass_kg: heavy, arm_m: way().toArm(wide), held_out: halves() !== "no",
        ...(frame().trim() ? { frame: frame().trim() } : {}),
        ...(series.value !== undefined ? { cells: series.value } : {}),
        ...(charge.value !== undefined ? { capacity_ah: charge.value } : {}),
        ...(tables().length > 0 ? { bench: tables() } : {}),
      }, { headers: { "idempotency-key": freshKey() } });
      props.twin.identify(made.id);
    });
  };

  return (
    <div class="stack">
      <form class="stack" aria-label="A vehicle from this log" onSubmit={(event) => void submit(event)} noValidate>
        <p class="small">
          What no log knows is how heavy the vehicle is and how large. Everything else is estimated from the motion: thrust curve, lag, inertia, drag, battery,
          and the order of the rotors where the log does not say it.
        </p>
        <div class="fields">
          <label class="field">Mass with battery, kg
            <input type="text" inputmode="decimal" size="8" value={mass()} aria-invalid={problem() !== undefined && numbers().mass.problem !== undefined} onInput={(event) => setMass(event.currentTarget.value)} />
          </label>
          <label class="field">Size is given as
            <select value={measure()} onChange={(event) => setMeasure(event.currentTarget.value)}>
              <For each={LENGTHS}>{(one) => <option value={one.key} selected={one.key === measure()}>{one.label}</option>}</For>
            </select>
          </label>
          <label class="field">{way().label.replace(/ \(.*$/, "")}
            <input type="text" inputmode="decimal" size="8" value={length()} aria-invalid={problem() !== undefined && numbers().length.problem !== undefined} onInput={(event) => setLength(event.currentTarget.value)} />
          </label>
          <label class="field">Name
            <input type="text" size="18" value={typedName()} placeholder={name()} aria-invalid={problem() !== undefined && nameProblem(name()) !== undefined} onInput={(event) => setName(event.currentTarget.value)} />
          </label>
        </div>
        <details>
          <summary>Where the log does not say it: frame, battery</summary>
          <div class="fields">
            <label class="field">Frame (motor numbers as in ArduPilot)
              <input type="text" size="18" list="frames" value={frame()} placeholder="as the log or the motion says" onInput={(event) => setFrame(event.currentTarget.value)} />
            </label>
            <datalist id="frames"><For each={FRAMES}>{(one) => <option value={one} />}</For></datalist>
            <label class="field">Cells in series<input type="text" inputmode="numeric" size="4" value={cells()} onInput={(event) => setCells(event.currentTarget.value)} /></label>
            <label class="field">Capacity, A h<input type="text" inputmode="decimal" size="6" value={capacity()} onInput={(event) => setCapacity(event.currentTarget.value)} /></label>
            <label class="check small"><input type="checkbox" checked={halves() !== "no"} onChange={(event) => setHalves(event.currentTarget.checked ? "" : "no")} /> predict each half of the flight with what the other half gave (takes longer)</label>
          </div>
        </details>
        <BenchTables tables={tables()} change={(next) => setBench(next.length > 0 ? JSON.stringify(next) : "")} />
        <Problem sentence={problem()} />
        <div class="row"><button type="submit" class="main" disabled={busy() || job.running()}>{busy() ? "Asking …" : job.result() ? "Identify again" : "Identify the vehicle"}</button></div>
      </form>
      <JobProgress job={{ ...job, error: () => job.error() && withoutPlace(job.error() ?? "") }} what="Identifying the vehicle" />
      <Show when={job.error()}>
        <p class="small">
          Nothing was changed, and what you typed is still there. What to fly: 5 s standing still, 20 s of roll and pitch doublets, 10 s of yaw steps, 10 s of
          throttle pulses; body rates, accelerometer and motor outputs at 200 Hz or more.
        </p>
      </Show>
      <Show when={job.result()}>
        {(found) => <Found found={found()} job={job.job()} id={props.twin.identification() ?? ""} twin={props.twin} taken={props.taken} onKept={props.onKept} />}
      </Show>
    </div>
  );
}

/** Tables of a thrust bench, dropped or chosen: the data read from each, and a button to remove it. */
function BenchTables(props: { tables: readonly BenchTable[]; change: (tables: BenchTable[]) => void }) {
  const [over, setOver] = createSignal(false);
  const [problem, setProblem] = createSignal<string>();
  const take = async (files: readonly File[]) => {
    setProblem(undefined);
    const tables = [...props.tables];
    for (const file of files) {
      const table = benchTable(file.name, new Uint8Array(await file.arrayBuffer()));
      if ("problem" in table) {
        setProblem(table.problem);
        continue;
      }
      // Another file of the same name replaces the earlier one.
      const at = tables.findIndex((one) => one.name === table.name);
      if (at < 0) tables.push(table);
      else tables[at] = table;
    }
    props.change(tables);
  };
  return (
    <div
      class="drop small" classList={{ over: over() }} role="group" aria-label="Thrust bench"
      onDragOver={(event) => { event.preventDefault(); setOver(true); }} onDragLeave={() => setOver(false)}
      onDrop={(event) => { event.preventDefault(); event.stopPropagation(); setOver(false); void take([...(event.dataTransfer?.files ?? [])]); }}
    >
      <p>
        <strong>Was the rotor on a thrust bench?</strong> Drop its table here, or that of a datasheet: throttle and thrust of one rotor, and where you have them voltage, current or
        power, torque; several voltages as several files. Units stand in the header, as in <code>thrust [g]</code>; what has none is taken as N, V, A, N·m, W, and the result says so.
      </p>
      <label class="button">
        Choose tables (.csv)
        <input class="sr" type="file" multiple accept=".csv,.tsv,.txt" onChange={(event) => { void take([...(event.currentTarget.files ?? [])]); event.currentTarget.value = ""; }} />
      </label>
      <Problem sentence={problem()} />
      <ul class="plain">
        <For each={props.tables}>
          {(table) => (
            <li class="row">
              <strong>{table.name}</strong>
              <span class="muted">{count(shapeOf(table.text).rows, "row")}: {shapeOf(table.text).columns.slice(0, 8).join(", ")}</span>
              <button type="button" class="plain" onClick={() => props.change(props.tables.filter((one) => one.name !== table.name))}>Remove<span class="sr"> {table.name}</span></button>
            </li>
          )}
        </For>
      </ul>
    </div>
  );
}

function Found(props: { found: Identification; job: JobView | undefined; id: string; twin: Twin; taken: readonly string[]; onKept: () => void }) {
  const it = () => props.found.identified;
  const name = () => props.job?.name ?? "";
  const rotors = () => rotorsOf(props.found.vehicle);
  const { busy, problem, attempt } = createAttempt();
  const kept = () => props.twin.made() === props.id;
  let head: HTMLHeadingElement | undefined;
  // The answer appears where the user waits for it, and is announced to screen readers.
  createEffect(() => props.found && head?.focus({ preventScroll: true }));
  const keep = () => attempt(async () => {
    const answer = await ask<Schemas["KeptVehicle"]>("POST", `/api/v1/identifications/${props.id}/keep`);
    props.onKept();
    props.twin.chooseMade(answer.vehicle, props.id);
  });
  // Who asks for a vehicle wants to go on with it. It is kept unless it would take the place of another one than that of this flight.
  createEffect(on(() => props.twin.justIdentified() === props.id && !kept(), (go) => {
    const again = props.twin.made() !== undefined && props.twin.vehicle() === name();
    if (!go || (props.taken.includes(name()) && !again)) return;
    props.twin.identifiedSeen();
    void keep();
  }));
  return (
    <div class="card found" aria-label="The identified vehicle" role="group">
      <div class="row">
        <h3 ref={head} tabindex="-1">{name()}, from {it().logs.join(", ")}</h3>
        <span class="tag">{it().airframe.name}</span>
        <span class="tag">defaults of the class {it().class.name}</span>
      </div>
      <div class={kept() ? "stack" : "side"}>
        <div class="stack">
          <p class="small">
            {it().outputs.length} rotors on outputs {it().outputs.join(", ")}; order and spin: {sourceOf(it().airframe.source).words} ({it().airframe.how}).
            In the air: {it().airborne.map((part) => `${short(part.start_s)} – ${short(part.end_s)} s`).join(", ")}.
          </p>
          <div class="row">
            <Show when={!kept()} fallback={<><span class="tag good">kept as {name()}, and chosen</span><span class="small">The comparison with it is in <a href="#step-4">step 4</a>.</span></>}>
              <button type="button" class="main" disabled={busy()} onClick={() => void keep()}>{busy() ? "Keeping …" : `Keep it as ${name()} and use it`}</button>
            </Show>
            <Show when={!kept() && props.taken.includes(name())}>
              <span class="small">There is a vehicle {name()} already: yours takes its place in your library. Another name above, and “Identify again”, keeps both.</span>
            </Show>
          </div>
          <Problem sentence={problem()} />
        </div>
        <Show when={!kept() && rotors()} fallback={<Show when={!kept()}><p class="small muted">The picture comes when the vehicle is kept.</p></Show>}>
          {(list) => <VehiclePicture geometry={{ name: name(), rotors: list() }} />}
        </Show>
      </div>
      <Show when={benchNotes(it().notes).bench.length > 0}>
        <div class="say">
          <strong>{it().values.some((one) => one.source === "bench") ? "Of the bench" : "Nothing of the bench was used"}</strong>
          <ul class="small"><For each={benchNotes(it().notes).bench}>{(one) => <li>{one}</li>}</For></ul>
        </div>
      </Show>
      <div class={`say ${answerOf(it().values).kind}`}><strong>{answerOf(it().values).head}</strong> {answerOf(it().values).rest}</div>
      <Show when={failsOn(props.found.held_out)}>{(answer) => <div class={`say ${answer().kind}`}><strong>{answer().head}</strong> {answer().rest}</div>}</Show>
      <Advice values={it().values} />
      <ValueTable values={inOrder(it().values)} label="Identified values" />
      <HeldOut scores={props.found.held_out} />
      <Show when={benchNotes(it().notes).rest.length > 0}><ul class="small"><For each={benchNotes(it().notes).rest}>{(one) => <li>{one}</li>}</For></ul></Show>
      <details>
        <summary>The documents: vehicle and blades (TOML)</summary>
        <pre tabindex="0" aria-label="vehicle document">{props.found.vehicle}</pre>
        <pre tabindex="0" aria-label="blades document">{props.found.blades}</pre>
      </details>
    </div>
  );
}
