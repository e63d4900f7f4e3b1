/** Controllers compared on runs of one scenario: one column per run, the rows of `rotortwin controllers`. */
import { For, Show } from "solid-js";
import type { Schemas } from "../api/client";
import { short } from "../format";

export type Compared = Schemas["ComparedControllers"];
type Row = Schemas["ControllerRow"];
type Spread = Schemas["Spread"];

export function Controllers(props: { compared: Compared; /** Of each run. */ names: readonly string[]; link?: (run: string) => string }) {
  const lines = () => linesOf(props.compared);
  return (
    <div class="stack">
      <For each={props.compared.differences}>{(difference) => <div class="say warn">Careful: {difference}.</div>}</For>
      <div class="scroll" tabindex="0" role="region" aria-label="Controllers compared">
        <table class="small">
          <thead>
            <tr>
              <th scope="col">Flight</th>
              <For each={props.compared.rows}>
                {(row, k) => <th class="r" scope="col"><Show when={props.link} fallback={props.names[k()]}>{(link) => <a href={link()(row.run)}>{props.names[k()]}</a>}</Show></th>}
              </For>
            </tr>
          </thead>
          <tbody>
            <For each={lines()}>
              {(line) => (
                <tr>
                  <th scope="row">{line.name}</th>
                  <For each={line.cells}>{(cell) => <td class={line.words ? "r long" : "r"}>{cell}</td>}</For>
                </tr>
              )}
            </For>
          </tbody>
        </table>
      </div>
      <p class="small muted">
        Errors: true state against the reference of the scenario, which is the same for every controller; roll and pitch against what the controller asked of its inner loop, where it reports that.
        Verdicts are those of the sequential detector.
      </p>
    </div>
  );
}

/** A row of the table; omitted if no flight has a value. */
interface Line {
  name: string;
  cells: string[];
  words?: boolean;
}

const NONE = "–";

/** The rows, in the order of `rotortwin controllers`. */
export function linesOf({ rows, within_m }: Compared): Line[] {
  const line = (name: string, of: (row: Row) => string | null | undefined, words = false): Line => ({ name, cells: rows.map((row) => of(row) ?? NONE), words });
  const number = (value: number | null | undefined, unit: string) => (value === null || value === undefined ? null : `${short(value)} ${unit}`);
  const spread = (name: string, unit: string, of: (row: Row) => Spread | null | undefined) => [
    line(`${name}, rms`, (row) => number(of(row)?.rms, unit)),
    line(`${name}, largest`, (row) => number(of(row)?.max, unit)),
  ];
  const answer = (yes: boolean | null | undefined) => (yes === null || yes === undefined ? null : yes ? "yes" : "no");
  const fault = rows.find((row) => row.fault)?.fault;
  return [
    line("flown by", (row) => row.controller, true),
    line("version", (row) => row.version, true),
    line("lockstep", (row) => answer(row.lockstep)),
    line("ended as", (row) => (row.failure ? `${row.status}: ${row.failure}` : row.status), true),
    ...spread("position error", "m", (row) => row.position_m),
    ...spread("yaw error", "°", (row) => row.yaw_deg),
    ...spread("roll and pitch against set-point", "°", (row) => row.roll_pitch_deg),
    line("tilt, largest", (row) => number(row.tilt_deg?.max, "°")),
    line("energy", (row) => number(row.energy_wh, "Wh")),
    line("false alarms", (row) => String(row.false_alarms)),
    ...(fault
      ? [
          line(`${fault.description} from ${short(fault.onset_s)} s on: detected after`, (row) => number(row.fault?.detected_after_s, "s")),
          line("isolated after", (row) => number(row.fault?.isolated_after_s, "s")),
          line("right at the end", (row) => answer(row.fault?.right_at_end)),
          line("farthest from the reference", (row) => number(row.fault?.farthest_m, "m")),
          line(`within ${short(within_m)} m again after`, (row) => number(row.fault?.recovered_after_s, "s")),
        ]
      : []),
  ].filter((one) => one.cells.some((cell) => cell !== NONE));
}
