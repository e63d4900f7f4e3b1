/**
 * State of the twin page. All of it is in the address: flights, vehicle, model, version, their jobs, and the current
 * selection. Missing results are requested; a repeated request returns the existing job.
 */
import { createEffect, createMemo, createSignal, mapArray, on } from "solid-js";
import { type Schemas, ask, freshKey, get } from "../../api/client";
import { type JobView, createJob } from "../../api/job";
import { createLoad } from "../../api/load";
import { ApiError, sentenceOf } from "../../api/problem";
import { type Comparison, type Correction, type Diagnosis, type ImportResult, findingBlocks, keyOf, lineTo, together } from "../../model/twin";
import { isOfAnotherProgram, refusalWithoutCommand } from "../../model/table";
import { route, setQuery } from "../../router";

/** Default vehicle, that of the examples, and its rotors. */
const FIRST_VEHICLE = "f550";
const FIRST_ROTORS = 6;
const MAIN = "main";

export function createTwin() {
  const query = () => route().query;
  const all = (name: string) => createMemo(() => query().getAll(name), undefined, { equals: (a, b) => a.join() === b.join() });
  const one = (name: string) => createMemo(() => query().get(name) ?? undefined);
  const [logs, runs, held] = [all("log"), all("run"), all("held")];
  const [vehicle, model, version, cmp, diag] = [one("vehicle"), one("model"), one("v"), one("cmp"), one("diag")];
  // Additions and undo apply to one branch of the model; `main` by default.
  const branchAsked = one("br");
  const branch = () => branchAsked() ?? MAIN;
  // A vehicle identified from the flight, and the one that was stored and chosen.
  const [identification, made] = [one("ident"), one("made")];
  // The manoeuvre that distinguishes two effects, and the run that shows it.
  const [nextFlight, flown] = [one("next"), one("flown")];
  const [justIdentified, setJustIdentified] = createSignal<string>();
  const [fromLog, setFromLog] = createSignal(0);
  const [chosenVehicle, setChosenVehicle] = createSignal<string>();
  const [problem, setProblem] = createSignal<string>();
  const attempt = async (what: () => Promise<void>) => {
    setProblem(undefined);
    try {
      await what();
    } catch (error) {
      setProblem(sentenceOf(error));
    }
  };

  const imported = createJob<ImportResult>("logs", () => logs()[0]);
  // The server stores an upload as `log.csv`; its owner knows it by another name.
  const log = { ...imported, error: () => { const refusal = imported.error(); return refusal && refusalWithoutCommand(refusal.replace(/^log(\.\w+)?: /, `${imported.job()?.name}: `)); } };
  /** The columns have names of their own: the page asks what they are. */
  const ofAnotherProgram = () => isOfAnotherProgram(imported.error() ?? "");
  // Held-out flights are waited for, too; one that cannot be read is told, and left out of the comparison.
  const heldJobs = createMemo(mapArray(held, (id) => ({ id, ...createJob<ImportResult>("logs", () => id) })));
  const heldSettled = createMemo(() => heldJobs().every((one) => one.result() !== undefined || one.error() !== undefined));
  const heldRead = createMemo(() => heldJobs().filter((one) => one.result() !== undefined).map((one) => one.id), undefined, { equals: (a, b) => a.join() === b.join() });
  const heldProblems = createMemo(() =>
    heldJobs().flatMap((one) => (one.error() === undefined ? [] : [`${one.job()?.name ?? one.id}, to be held out: ${refusalWithoutCommand(one.error()?.replace(/^log(\.\w+)?: /, "") ?? "")}`])),
  );
  /** Held-out logs that were refused, and their files: what is said of the first log's columns may hold for them. */
  const heldRefused = () =>
    heldJobs().flatMap((one) => (one.job()?.status === "failed" ? [{ id: one.id, file: ((one.job()?.facts ?? {}) as Partial<Schemas["UploadFacts"]>).file ?? "" }] : []));
  const comparison = createJob<Comparison>("comparisons", cmp);
  const diagnosis = createJob<Diagnosis>("diagnoses", diag);
  const history = createLoad(model, (name, signal) => get("/api/v1/models/{name}/history", { path: { name }, signal }));
  const flightsReady = createMemo(() => (logs().length > 0 ? log.result() !== undefined : runs().length > 0));
  const vehicleName = () => vehicle() ?? FIRST_VEHICLE;
  // A log that could not be read has no channels to request.
  const channels = createLoad(
    () => {
      const [of, run] = [log.result() ? logs()[0] : undefined, logs().length === 0 ? runs()[0] : undefined];
      return of !== undefined || run !== undefined ? { log: of, run } : undefined;
    },
    ({ log, run = "" }, signal) => (log !== undefined ? get("/api/v1/logs/{id}/channels", { path: { id: log }, signal }) : get("/api/v1/runs/{id}/channels", { path: { id: run }, signal })),
  );
  const rotorsOfFlight = createMemo(() => channels.data()?.items.filter((one) => /^duty_\d+$/.test(one.name)).length);
  /** Rotors of a flight that no vehicle was chosen for, if the default one has another number. */
  const unfit = createMemo(() => {
    const count = rotorsOfFlight();
    return vehicle() === undefined && model() === undefined && count !== undefined && count > 0 && count !== FIRST_ROTORS ? count : undefined;
  });
  /** The vehicle was not chosen: the default one is taken for a log of its owner's, of which no parameter says what flew. */
  const assumed = createMemo(() => made() === undefined && (log.job()?.facts as Partial<Schemas["UploadFacts"]> | undefined)?.upload !== undefined && chosenVehicle() !== vehicle() && vehicle() === FIRST_VEHICLE);
  const vehicleKnown = createMemo(() => vehicle() !== undefined || channels.error() !== undefined || (rotorsOfFlight() !== undefined && unfit() === undefined));
  const head = () => history.data()?.branches.find((one) => one.name === branch());
  const shownVersion = () => (version() === undefined ? head()?.version : Number(version()));
  const line = createMemo(() => {
    const known = history.data();
    const shown = shownVersion();
    return known && known.name === model() && shown !== undefined ? lineTo(known, shown) : [];
  });

  // A separate model for each flight: additions do not affect others. Requesting an existing name is not an error.
  createEffect(
    on([flightsReady, vehicleKnown, vehicle, model, () => logs()[0] ?? runs()[0]], ([ready, known, , named, flight]) => {
      if (!ready || !known || named !== undefined || flight === undefined) return;
      const base = vehicleName();
      // A vehicle identified twice under one name is two vehicles.
      const name = [base, flight.slice(0, 32).slice(-8), made()?.slice(-4)].filter(Boolean).join("-");
      void attempt(async () => {
        const there = await get("/api/v1/models");
        try {
          if (!there.items.includes(name)) await ask("POST", "/api/v1/models", { name, model: { vehicle: base } });
        } catch (error) {
          // Another tab was faster.
          if (!(error instanceof ApiError) || error.status !== 409) throw error;
        }
        setQuery({ model: name, vehicle: base }, true);
      });
    }),
  );

  const submit = async (collection: string, body: unknown, parameter: string) => {
    // The hash of the version: a different version of the same number is a different job. `again` counts retries.
    const key = keyOf([collection, body, line().at(-1)?.hash, query().get("again")]);
    const job = await ask<JobView>("POST", `/api/v1/${collection}`, body, { headers: { "idempotency-key": key } });
    setQuery({ [parameter]: job.id }, true);
  };
  // With wrong axes a log seems to show missing physics: no model is compared with it.
  const blocked = createMemo(() => (log.result()?.report.findings ?? []).some((one) => findingBlocks(one.kind)));
  const ready = createMemo(() => flightsReady() && !blocked() && line().length > 0);
  createEffect(
    on([ready, heldSettled, cmp, line, query], ([go, settled, there, versions]) => {
      if (!go || !settled || there !== undefined || problem() !== undefined) return;
      // By the vehicle: the name of the model has a part of the flight's id in it.
      const models = versions.map((one) => ({ model: `${model()}@v${one.version}`, label: vehicle() === undefined ? one.label : `${vehicle()}@${one.label.replace(/^.*@/, "")}` }));
      const [first, ...more] = models;
      void attempt(() => submit("comparisons", {
        model: first,
        ...(more.length > 0 ? { more_models: more } : {}),
        flights: flightsOf([...logs(), ...heldRead()], runs()),
      }, "cmp"));
    }),
  );
  createEffect(
    on([ready, diag, cmp, line, query], ([go, there, compared, versions]) => {
      // After the comparison was requested: two workers then do both in parallel, one does the quick one first.
      if (!go || there !== undefined || compared === undefined || problem() !== undefined) return;
      void attempt(() => submit("diagnoses", { model: { model: `${model()}@v${versions.at(-1)?.version}` }, flights: flightsOf(logs(), runs()) }, "diag"));
    }),
  );

  const goTo = (at: number, of = branchAsked()) => setQuery({ ...begun, model: model(), br: of === MAIN ? undefined : of, v: String(at), again: undefined });
  /** Adds the findings of the diagnosis to the head of the branch. */
  const add = (what: { pick?: number; proposal?: true }) =>
    attempt(async () => {
      const seen = line().at(-1)?.hash ?? head()?.hash;
      const answer = await ask<Schemas["AddedVersion"]>(
        "POST", `/api/v1/models/${model()}/versions`, { diagnosis: diag(), branch: branch(), ...what },
        { headers: seen ? { "if-match": `"${seen}"`, "idempotency-key": freshKey() } : {} },
      );
      history.reload();
      goTo(answer.version.version);
    });
  /** Adds the corrections of constants that the flight contradicts, each effect once, to the head of the branch. */
  const calibrate = (corrections: readonly Correction[]) =>
    attempt(async () => {
      let seen = line().at(-1)?.hash ?? head()?.hash;
      let last: number | undefined;
      for (const one of together(corrections)) {
        const answer = await ask<Schemas["AddedVersion"]>(
          "POST", `/api/v1/models/${model()}/versions`, { effect: one, branch: branch(), note: `calibrated by the diagnosis ${diag()}` },
          { headers: seen ? { "if-match": `"${seen}"`, "idempotency-key": freshKey() } : {} },
        );
        seen = answer.version.hash;
        last = answer.version.version;
      }
      history.reload();
      if (last !== undefined) goTo(last);
    });
  const undo = () =>
    attempt(async () => {
      const seen = head()?.hash;
      const answer = await ask<Schemas["UndoneVersion"]>(
        "POST", `/api/v1/models/${model()}/undo`, { branch: branch() },
        { headers: seen ? { "if-match": `"${seen}"`, "idempotency-key": freshKey() } : {} },
      );
      history.reload();
      goTo(answer.version.version);
    });
  /** Starts a branch at the selected version and continues with it; the display does not change. */
  const beginBranch = async (name: string) => {
    const at = line().at(-1)?.version;
    await ask("POST", `/api/v1/models/${encodeURIComponent(model() ?? "")}/branches`, { name, at: `v${at}` });
    history.reload();
    setQuery({ br: name, v: String(at) });
  };
  const again = () => {
    setProblem(undefined);
    setQuery({ again: freshKey().slice(0, 6), cmp: undefined, diag: undefined, next: undefined, flown: undefined }, true);
  };

  return {
    logs, runs, held, identification, made, nextFlight, flown, vehicle: vehicleName, model, version, log, comparison, diagnosis, history, line, branch, head, problem, add, calibrate, undo, again, beginBranch,
    flightsReady, heldProblems, heldRefused, ofAnotherProgram, unfit, channels, rotorsOfFlight,
    /** Logs of the comparison, in its order. */
    compared: () => [...logs(), ...heldRead()],
    /** Whether there are a flight and a model to compare. */
    ready,
    /** Starts with other flights. */
    choose: (flights: { logs?: string[]; runs?: string[] }) =>
      setQuery({ log: flights.logs, run: flights.runs, held: undefined, vehicle: undefined, ident: undefined, made: undefined, ...begun, ch: undefined, again: undefined }),
    /** The same flight, imported again with other settings: the vehicle stays, and so do the held-out flights unless others are given. */
    reread: (id: string, holdNow: readonly string[] = held()) =>
      setQuery({ log: [id, ...logs().slice(1)], held: [...holdNow], ident: undefined, made: undefined, ...begun, again: undefined }),
    /** The training flights, as submissions name them. */
    flights: () => flightsOf(logs(), runs()),
    chooseVehicle: (name: string) => {
      setChosenVehicle(name);
      setQuery({ vehicle: name, made: undefined, ...begun });
    },
    assumed,
    /** Shows how a vehicle is identified. */
    identify: (id: string) => {
      setJustIdentified(id);
      setQuery({ ident: id }, true);
    },
    /** The identification that was asked for on this page and not yet continued with; a link to one continues with nothing by itself. */
    justIdentified,
    identifiedSeen: () => setJustIdentified(undefined),
    /** Opens the form for a vehicle from this flight. */
    fromLog,
    openFromLog: () => setFromLog((count) => count + 1),
    /** Continues with an identified and stored vehicle. */
    chooseMade: (name: string, id: string) => setQuery({ vehicle: name, made: id, ...begun }),
    chooseModel: (name: string) => setQuery({ made: undefined, ...begun, model: name }),
    chooseVersion: (number: number) => goTo(number),
    /** Continues with a branch, at its head. */
    chooseBranch: (name: string) => goTo(history.data()?.branches.find((one) => one.name === name)?.version ?? 0, name),
    hold: (ids: string[]) => setQuery({ held: ids, cmp: undefined }),
    proposeFlight: (id: string) => setQuery({ next: id, flown: undefined }, true),
    fly: (id: string) => setQuery({ flown: id }, true),
    channel: one("ch"),
    chooseChannel: (name: string) => setQuery({ ch: name }, true),
    logAt: () => Number(query().get("on") ?? 0),
    chooseLog: (place: number) => setQuery({ on: String(place) }, true),
  };
}

/** Results that depend on flights and vehicle, and are dropped with them. */
const begun = { model: undefined, br: undefined, v: undefined, cmp: undefined, diag: undefined, next: undefined, flown: undefined };

export type Twin = ReturnType<typeof createTwin>;

function flightsOf(logs: readonly string[], runs: readonly string[]) {
  return { ...(logs.length > 0 ? { logs: [...logs] } : {}), ...(runs.length > 0 ? { runs: [...runs] } : {}) };
}
