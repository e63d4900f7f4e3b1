/** Pages by address. */
import { ErrorBoundary, Match, Show, Suspense, Switch, createEffect, lazy } from "solid-js";
import { route } from "./router";
import { Shell } from "./shell/shell";
import { applyTheme } from "./theme";

const Twin = lazy(() => import("./pages/twin"));
const Runs = lazy(() => import("./pages/runs"));
const Run = lazy(() => import("./pages/run"));

const Campaigns = lazy(() => import("./pages/campaigns"));
const Blind = lazy(() => import("./pages/blind"));
const Fdi = lazy(() => import("./pages/fdi"));
const Library = lazy(() => import("./pages/library"));

const TITLES: Record<string, string> = { twin: "Twin", runs: "Runs", campaigns: "Campaigns", blind: "Blind benches", fdi: "FDI monitor", library: "Library" };

export function App() {
  applyTheme();
  const parts = () => route().path.split("/").filter(Boolean);
  const page = () => parts()[0] ?? "twin";
  const item = () => parts()[1];
  createEffect(() => {
    document.title = `${TITLES[page()] ?? "Not found"} · rotortwin`;
  });
  return (
    <Shell>
      <ErrorBoundary fallback={(error: unknown, reset) => (
        <div class="say bad" role="alert">
          This page failed: {String(error)}. <button type="button" onClick={reset}>Show it again</button>
        </div>
      )}>
        <Suspense fallback={<p class="muted">Loading …</p>}>
          <Switch fallback={<p class="say warn">There is no page at {route().path}.</p>}>
            <Match when={page() === "twin"}><Twin /></Match>
            <Match when={page() === "runs"}>
              <Show when={item()} fallback={<Runs />} keyed>{(id) => <Run id={id} />}</Show>
            </Match>
            <Match when={page() === "campaigns"}><Campaigns id={item()} /></Match>
            <Match when={page() === "blind"}><Blind id={item()} /></Match>
            <Match when={page() === "fdi"}><Fdi /></Match>
            <Match when={page() === "library"}><Library /></Match>
          </Switch>
        </Suspense>
      </ErrorBoundary>
    </Shell>
  );
}
