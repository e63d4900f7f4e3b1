/** A diagnosis with its flights, as its report shows it. */
import { Show } from "solid-js";
import type { Diagnosis } from "../model/twin";
import { Panel } from "../parts/bits";
import { DiagnosisView } from "./diagnosis";
import { type OverTime, OverTimeView } from "./over-time";

export interface DiagnosisReport {
  diagnosis: Diagnosis;
  over_time: OverTime | null;
}

export function DiagnosisReportView(props: { report: DiagnosisReport }) {
  const found = () => props.report.diagnosis;
  return (
    <>
      <Panel title="What is missing" note={found().model.name}><div class="stack"><DiagnosisView found={found()} compared={props.report.over_time?.compared?.comparison} /></div></Panel>
      <Show when={props.report.over_time}>{(data) => <OverTimeView data={data()} />}</Show>
    </>
  );
}
