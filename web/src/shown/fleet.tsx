/** The flights of a vehicle, one after the other: each rotor's loss, and which propeller to inspect. */
import { For, Show } from "solid-js";
import { Panel } from "../parts/bits";
import { Chart } from "../plots/chart";
import { seriesColour } from "../theme";

interface Share {
  share: number;
  low: number;
  high: number;
}
interface Rotor {
  rotor: number;
  status: "ok" | "inspect" | "acknowledged" | "too_few_flights";
  reasons: string[];
  since_flight: number;
  bias: Share | null;
  loss: { course: "trend" | "step"; from_flight: number; flights: number; lost: Share; per_flight: Share | null } | null;
  course: (Share & { flight: number })[];
}
interface Flight {
  flight: number;
  log: string;
  date: string | null;
  air_s: number;
  common_bias: number;
  bias: number[];
  losses: { rotor: number; share: number; low: number; high: number }[];
}
/** A vehicle in the output of `rotortwin fleet show --json`. */
export interface FleetVehicle {
  vehicle: string;
  model: string;
  by_date: boolean;
  spread: number | null;
  common_per_flight: Share | null;
  rotors: Rotor[];
  flights: Flight[];
  maintenance: { event: string; rotor: number; after_flight: number; by: string; date: string; note: string }[];
}

const signed = (share: number, decimals = 1) => `${share < 0 ? "−" : "+"}${Math.abs(100 * share).toFixed(decimals)}`;
const interval = (one: Share | null | undefined) => (one ? `${signed(one.share)} % [${signed(one.low)}, ${signed(one.high)}]` : "–");
/** A date, with the time of day if known. */
const day = (date: string) => (date.endsWith("T00:00:00Z") ? date.slice(0, 10) : `${date.slice(0, 10)} ${date.slice(11, 16)} UTC`);
const DONE: Record<string, string> = { acknowledge: "acknowledged", reset: "replaced" };
const WORDS = { ok: ["", "ok"], inspect: ["bad", "inspect"], acknowledged: ["warn", "acknowledged"], too_few_flights: ["", "too few flights"] } as const;

export function FleetView(props: { vehicles: readonly FleetVehicle[] }) {
  return <For each={props.vehicles}>{(one) => <Panel title={one.vehicle} note={`${one.flights.length} flights, compared with ${one.model}`}><Vehicle one={one} /></Panel>}</For>;
}

function Vehicle(props: { one: FleetVehicle }) {
  const it = () => props.one;
  const wanted = () => it().rotors.filter((rotor) => rotor.reasons.length > 0);
  const flights = () => it().flights.map((flight) => flight.flight);
  const courses = () => it().rotors.filter((rotor) => rotor.course.length > 0);
  const at = (rotor: Rotor, value: (one: Share) => number) => flights().map((flight) => {
    const found = rotor.course.find((one) => one.flight === flight);
    return found ? 100 * value(found) : null;
  });
  return (
    <div class="stack">
      <Show when={wanted().length > 0} fallback={<div class="say good">No rotor deviates significantly.</div>}>
        <For each={wanted()}>{(rotor) => <div class={`say ${WORDS[rotor.status][0]}`}><strong>{rotor.status === "acknowledged" ? "Acknowledged" : "Inspect"}: rotor {rotor.rotor}</strong> {rotor.reasons.join("; ")}.</div>}</For>
      </Show>
      <Show when={it().common_per_flight}>{(common) => <div class="say warn">All rotors are asked for {interval(common())} more from flight to flight: battery, air, mass, or all propellers together.</div>}</Show>
      <Show when={courses().length > 0}>
        <Chart
          title="Loss of each rotor against the first flights, if it alone had changed (bands: 95 % by the spread between flights)"
          unit="%" x={flights()} xLabel="flight" xUnit="" xWhole
          lines={courses().map((rotor) => ({ label: `rotor ${rotor.rotor}`, values: at(rotor, (one) => one.share), colour: seriesColour(rotor.rotor - 1), ...(rotor.rotor > 8 ? { dash: [6, 3] } : {}) }))}
          bands={courses().filter((rotor) => rotor.reasons.length > 0).map((rotor) => ({ label: `rotor ${rotor.rotor}, 95 %`, low: at(rotor, (one) => one.low), high: at(rotor, (one) => one.high), colour: seriesColour(rotor.rotor - 1) }))}
        />
      </Show>
      <div class="scroll" tabindex="0" role="region" aria-label={`Rotors of ${it().vehicle}`}>
        <table class="small">
          <thead><tr><th class="r" scope="col">rotor</th><th scope="col">status</th><th class="r" scope="col">since flight</th><th class="r" scope="col">bias now</th><th class="r" scope="col">loss over flights</th><th class="r" scope="col">per flight</th></tr></thead>
          <tbody><For each={it().rotors}>{(rotor) => <tr><th class="r" scope="row">{rotor.rotor}</th><td>{WORDS[rotor.status][1]}</td><td class="r">{rotor.since_flight}</td><td class="r">{interval(rotor.bias)}</td><td class="r">{interval(rotor.loss?.lost)}</td><td class="r">{interval(rotor.loss?.per_flight)}</td></tr>}</For></tbody>
        </table>
      </div>
      <div class="scroll" tabindex="0" role="region" aria-label={`Flights of ${it().vehicle}`}>
        <table class="small">
          <thead><tr><th class="r" scope="col">flight</th><th scope="col">date</th><th scope="col">log</th><th class="r" scope="col">in the air, s</th><th class="r" scope="col">bias of all, %</th><For each={it().rotors}>{(rotor) => <th class="r" scope="col">rotor {rotor.rotor}</th>}</For><th scope="col">within the flight</th></tr></thead>
          <tbody><For each={it().flights}>{(flight) => <tr><th class="r" scope="row">{flight.flight}</th><td class="num">{flight.date ? day(flight.date) : "–"}</td><td class="break">{flight.log}</td><td class="r">{flight.air_s.toFixed(0)}</td><td class="r">{signed(flight.common_bias)}</td><For each={flight.bias}>{(bias) => <td class="r">{signed(bias, 2)}</td>}</For><td>{flight.losses.map((loss) => `rotor ${loss.rotor} lost ${interval(loss)}`).join(", ") || "–"}</td></tr>}</For></tbody>
        </table>
      </div>
      <ul class="small"><For each={it().maintenance}>{(one) => <li>Rotor {one.rotor} {DONE[one.event] ?? one.event} after flight {one.after_flight}, {day(one.date)}, by {one.by}{one.note ? `: ${one.note}` : ""}</li>}</For></ul>
      <p class="small muted">
        Bias: commanded thrust of a rotor over the model's, apart from what all rotors have in common. In the chart, a rotor that seems to gain is the one across from a rotor that loses. <Show when={it().spread}>{(spread) => <>Spread between flights: {(100 * spread()).toFixed(2)} % of a rotor's thrust, 1 σ. </>}</Show>
        {it().by_date ? "Flights by date." : "Flights in the order of entry: not every one has a date."}
      </p>
    </div>
  );
}
