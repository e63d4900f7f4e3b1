/** How a run ended, interval by interval. */
import { For, Show } from "solid-js";
import { duration, percent, short, verdictText } from "../format";
import { type Score, type Summary, kindOfScore, lateWords, otherwise, peersOf } from "../model/run";
import { Figures, Panel } from "../parts/bits";

const OURS = ["sequential", "T-test", "network"] as const;
const KEYS = { sequential: "sequential", "T-test": "t_test", network: "network" } as const;

export function RunSummary(props: { summary: Summary }) {
  const it = () => props.summary;
  /** Scores of the user's own detectors in an interval. */
  const own = (interval: number): [string, Score, string?][] =>
    (it().own_detectors ?? []).flatMap((one) => { const score = one.scores[interval]; return score ? [[one.name, score, one.statements?.[interval]?.text]] : []; });
  const absent = () => (it().intervals ?? []).every((one) => typeof one.scores.network.share_right !== "number");
  return (
    <Panel title="Summary" note={it().program_version}>
      <div class="stack">
        <Show when={it().failure}>
          {(failure) => (
            <div class="say bad">
              {failure().sentence}{" "}
              <span class="small">Peer: {failure().peer}; last complete step: {failure().step.toLocaleString("en")}{failure().silence_ms > 0 ? `; silent for ${failure().silence_ms.toLocaleString("en")} ms` : ""}.</span>
            </div>
          )}
        </Show>
        <Figures
          items={[
            ["simulated", duration(it().simulated_s)],
            ["steps", it().steps.toLocaleString("en")],
            ["took", duration(it().wall_s)],
            ["steps per second", it().steps_per_s > 1000 ? Math.round(it().steps_per_s).toLocaleString("en") : short(it().steps_per_s)],
            // Of a flight without a step nothing is known.
            ...(it().steps === 0 ? [] : ([
              ["position error, rms", `${short(it().tracking?.position_rms_m)} m`],
              ["largest", `${short(it().tracking?.position_max_m)} m`],
              ["charge", `${percent(it().battery?.state_of_charge_start, 0)} → ${percent(it().battery?.state_of_charge_end, 0)}`],
              ["lowest voltage", `${short(it().battery?.voltage_min_v, 4)} V`],
            ] as const)),
            ["run hash", <code class="small">{it().run_hash.slice(0, 16)}</code>],
          ]}
        />
        <Show when={peersOf(it())}>{(words) => <p class="small muted">{words()}.</p>}</Show>
        <Show when={it().real_time}>
          {(time) => (
            <p class="small muted">
              Lateness of a step: median {short(time().jitter_us_p50)} µs, 99 % {short(time().jitter_us_p99)} µs, worst {short(time().jitter_us_max)} µs;
              {" "}{time().deadline_misses.toLocaleString("en")} steps late{time().overrun_ms_max ? `, ${short(time().overrun_ms_max)} ms at worst` : ""}
              {time().priority === undefined ? "" : `; real-time priority ${time().priority}`}.
              <For each={time().late ?? []}>{(one) => <> The {lateWords(one)}.</>}</For>
            </p>
          )}
        </Show>
        <Show when={(it().intervals ?? []).length > 0}>
          <div class="scroll" tabindex="0" role="region" aria-label="What the detectors said, by interval">
            <table class="small">
              <thead>
                <tr>
                  <th scope="col">Interval, s</th><th scope="col">Truth</th><th scope="col">Detector</th>
                  <th class="r" scope="col">correct windows</th><th class="r" scope="col">detection delay, s</th><th class="r" scope="col">false alarms</th>
                  <th scope="col">other windows</th><th scope="col">at the end</th><th scope="col">estimated loss</th>
                </tr>
              </thead>
              <tbody>
                <For each={it().intervals}>
                  {(interval, number) => (
                    <For each={[...OURS.map((one) => [one, interval.scores[KEYS[one]], undefined] as const), ...own(number())]}>
                      {([name, score, said], place) => (
                        <tr>
                          <td class="num">{place() === 0 ? `${short(interval.start_s)} – ${short(interval.end_s)}` : ""}</td>
                          <td>{place() === 0 ? [interval.description, ...(interval.sensor_faults ?? [])].join("; ") : ""}</td>
                          <td>{name}</td>
                          <td class="r"><span class={`tag ${kindOfScore(interval, score)}`}>{typeof score.share_right !== "number" ? (name === "network" && absent() ? "no network loaded" : "no verdict") : percent(score.share_right)}</span></td>
                          <td class="r">{short(score.isolated_after_s)}</td>
                          <td class="r">{score.false_alarm_events}</td>
                          <td>{otherwise(interval, score)}</td>
                          <td>{said || verdictText(score.verdict_at_end)}</td>
                          <td class="num">
                            {name === "sequential"
                              ? (interval.severity?.losses ?? []).map((loss) => `rotor ${loss.rotor}: ${percent(loss.share)} [${percent(loss.interval_share[0])}, ${percent(loss.interval_share[1])}]`).join("; ")
                              : ""}
                          </td>
                        </tr>
                      )}
                    </For>
                  )}
                </For>
              </tbody>
            </table>
          </div>
          <p class="small muted">
            Correct windows: green without a fault if there is no false alarm and none of before goes on, with one if the verdict is correct at the end and in at least 90 % of the windows; red if the rotor is
            never named, or a healthy one is named all the time. A delay counts from the start of the interval to the end of the first window with the correct verdict.
          </p>
        </Show>
        <details>
          <summary>The scenario as it was flown</summary>
          <pre tabindex="0" aria-label="scenario">{it().scenario.text}</pre>
        </details>
      </div>
    </Panel>
  );
}
