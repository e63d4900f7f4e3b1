/** The frame of a report, and the choice of the view for its result. */
import { ErrorBoundary, Match, Show, Switch, createSignal, onCleanup } from "solid-js";
import type { Improvement } from "../model/twin";
import { type BlindReport, BlindReportView } from "../shown/blind";
import { type CampaignReport, CampaignReportView } from "../shown/campaign";
import { ComparedView } from "../shown/compared";
import type { ComparisonReport } from "../shown/compared-series";
import { type DiagnosisReport, DiagnosisReportView } from "../shown/diagnosed";
import { type FitResult, FitView } from "../shown/fit";
import { type FleetVehicle, FleetView } from "../shown/fleet";
import { type IdentifiedReport, IdentifiedReportView } from "../shown/identified";
import { ImprovementView } from "../shown/improvement";
import { type JudgedLogs, JudgedView } from "../shown/judged";
import { type Reproduction, ReproductionView } from "../shown/reproduction";
import { type RunReport, RunReportView } from "../shown/run-report";
import { applyTheme, dark, setTheme } from "../theme";

/** Content: kind and shape of `data` belong together. */
export interface Content {
  kind: string;
  title: string;
  program: string;
  data: unknown;
}

/** A server shows files of jobs in a sandbox, where a page cannot open dialogs: save it, or print from the browser's menu. */
const canPrint = location.protocol === "file:" || self.origin !== "null";

export function Report(props: Content) {
  applyTheme();
  openForPrint();
  return (
    <>
      <header class="bar">
        <span class="brand grow break">{props.title}</span>
        <Show when={canPrint}><button type="button" class="screen" onClick={() => window.print()}>Print</button></Show>
        <button type="button" class="screen" onClick={() => setTheme(dark() ? "light" : "dark")}>light / dark</button>
      </header>
      <main id="content">
        <h1 class="sr">{props.title}</h1>
        <ErrorBoundary fallback={(error: unknown) => <div class="say bad" role="alert">This report cannot be shown: {String(error)}. Its data is in the file, under id "report".</div>}>
          <Switch fallback={<p class="say warn">This file holds a {props.kind}, which this page does not know.</p>}>
            <Match when={props.kind === "comparison"}><ComparedView report={props.data as ComparisonReport} /></Match>
            <Match when={props.kind === "diagnosis"}>
              <DiagnosisReportView report={props.data as DiagnosisReport} />
            </Match>
            <Match when={props.kind === "campaign"}><CampaignReportView report={props.data as CampaignReport} /></Match>
            <Match when={props.kind === "blind"}><BlindReportView report={props.data as BlindReport} /></Match>
            <Match when={props.kind === "fit"}><FitView fits={props.data as FitResult[]} /></Match>
            <Match when={props.kind === "fleet"}><FleetView vehicles={props.data as FleetVehicle[]} /></Match>
            <Match when={props.kind === "reproduction"}><ReproductionView result={props.data as Reproduction} /></Match>
            <Match when={props.kind === "run"}><RunReportView report={props.data as RunReport} /></Match>
            <Match when={props.kind === "judged"}><JudgedView logs={props.data as JudgedLogs} /></Match>
            <Match when={props.kind === "identification"}><IdentifiedReportView report={props.data as IdentifiedReport} /></Match>
            <Match when={props.kind === "improvement"}><ImprovementView result={props.data as Improvement} /></Match>
          </Switch>
        </ErrorBoundary>
      </main>
      <footer>
        <span>{props.program}</span>
        <span>One file, works offline. {props.kind === "reproduction" ? "What ± is, the notes of each table say." : "A value ± is given with its 95 % interval."} Rotors are numbered from 1. Axes: north, east, down; body forward, right, down.</span>
      </footer>
    </>
  );
}

/** Collapsed parts are expanded for printing, and collapsed again afterwards. */
function openForPrint(): void {
  const [opened, setOpened] = createSignal<HTMLDetailsElement[]>([]);
  const before = () => {
    const folded = [...document.querySelectorAll<HTMLDetailsElement>("details.whole:not([open])")];
    for (const one of folded) one.open = true;
    setOpened(folded);
  };
  const after = () => {
    for (const one of opened()) one.open = false;
  };
  window.addEventListener("beforeprint", before);
  window.addEventListener("afterprint", after);
  onCleanup(() => {
    window.removeEventListener("beforeprint", before);
    window.removeEventListener("afterprint", after);
  });
}
