/** Elements of every page: navigation, theme, the message about an unreachable server, sign-in. */
import { For, Show, createSignal, type JSX, onCleanup } from "solid-js";
import { away } from "../api/connection";
import { hasSignedIn, signOut } from "../api/session";
import { followLinks, route } from "../router";
import { SignIn } from "./sign-in";
import { setTheme, theme, type Theme } from "../theme";

const PAGES = [
  { path: "/twin", title: "Twin" },
  { path: "/runs", title: "Runs" },
  { path: "/campaigns", title: "Campaigns" },
  { path: "/blind", title: "Blind benches" },
  { path: "/fdi", title: "FDI monitor" },
  { path: "/library", title: "Library" },
] as const;

export function Shell(props: { children: JSX.Element }) {
  const current = (path: string) => (route().path === path || (path === "/twin" && route().path === "/") || route().path.startsWith(`${path}/`) ? "page" : undefined);
  return (
    <div onClick={followLinks}>
      <a class="skip" href="#content">Skip to the content</a>
      <header class="bar">
        <a class="brand" href="/">
          <svg viewBox="0 0 32 32" aria-hidden="true">
            <circle cx="8" cy="8" r="5" /><circle cx="24" cy="8" r="5" /><circle cx="8" cy="24" r="5" /><circle cx="24" cy="24" r="5" />
            <path d="M11 11l10 10M21 11L11 21" />
          </svg>
          rotortwin
        </a>
        <nav class="nav" aria-label="Pages">
          <For each={PAGES}>{(page) => <a href={page.path} aria-current={current(page.path)}>{page.title}</a>}</For>
        </nav>
        <label class="row small">
          <span class="sr">Colours</span>
          <select value={theme()} onChange={(event) => setTheme(event.currentTarget.value as Theme)}>
            <option value="system">system colours</option>
            <option value="light">light colours</option>
            <option value="dark">dark colours</option>
          </select>
        </label>
      </header>
      <Away />
      <SignIn />
      <main id="content" tabindex="-1">{props.children}</main>
      <footer>
        <a href="/api/v1/docs">API</a>
        <a href="/api/v1/openapi.json">OpenAPI</a>
        <a href="/metrics">metrics</a>
        <Show when={hasSignedIn()}><button type="button" onClick={() => void signOut()}>Sign out</button></Show>
        <span>A value ± is given with its 95 % interval. Rotors are numbered from 1. Axes: north, east, down; body forward, right, down.</span>
      </footer>
    </div>
  );
}

/** Shows that the server does not respond, and since when. */
function Away() {
  return (
    <div role="status" aria-live="polite">
      <Show when={away()}>
        <Waiting />
      </Show>
    </div>
  );
}

function Waiting() {
  const since = Date.now();
  const [seconds, setSeconds] = createSignal(0);
  const timer = setInterval(() => setSeconds(Math.round((Date.now() - since) / 1000)), 1000);
  onCleanup(() => clearInterval(timer));
  return (
    <div class="away">
      The server at {location.host} does not answer ({seconds()} s). Trying again; what you typed stays, and requests are repeated when it is back.
    </div>
  );
}
