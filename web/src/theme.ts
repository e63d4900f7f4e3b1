/** Dark or light: as the system says, until somebody chooses. Pictures on a canvas ask here for their colours. */
import { createRenderEffect, createSignal } from "solid-js";

export type Theme = "system" | "light" | "dark";
const KEY = "rotortwin.theme";
const system = matchMedia("(prefers-color-scheme: dark)");

const stored = (): Theme => {
  let value: string | null = null;
  try {
    value = localStorage.getItem(KEY);
  } catch {
    // A page without an origin, such as a report in a sandbox, keeps nothing.
  }
  return value === "light" || value === "dark" ? value : "system";
};
const [theme, choose] = createSignal<Theme>(stored());
const [systemDark, setSystemDark] = createSignal(system.matches);
system.addEventListener("change", (event) => setSystemDark(event.matches));

// Paper is white: pictures are drawn again for it.
const [printing, setPrinting] = createSignal(false);
window.addEventListener("beforeprint", () => setPrinting(true));
window.addEventListener("afterprint", () => setPrinting(false));

/** What was chosen. */
export { theme };

/** Whether the page is dark now; pictures depend on it. */
export const dark = () => !printing() && (theme() === "system" ? systemDark() : theme() === "dark");

export function setTheme(next: Theme): void {
  try {
    if (next === "system") localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, next);
  } catch {
    // It holds as long as the page is open.
  }
  choose(next);
}

/** Keeps the document's attribute in step. */
export function applyTheme(): void {
  // Before the pictures are drawn, which read the colours of the document.
  createRenderEffect(() => {
    const shown = printing() ? "light" : theme();
    if (shown === "system") delete document.documentElement.dataset["theme"];
    else document.documentElement.dataset["theme"] = shown;
  });
}

/** The value of a colour variable now; reads `dark()`, so that what depends on it is drawn again. */
export function colour(name: string): string {
  dark();
  const probe = document.createElement("span");
  probe.style.setProperty("color", `var(--${name})`);
  document.body.append(probe);
  const value = getComputedStyle(probe).color;
  probe.remove();
  return value;
}

/** Colours of rotors and other series, told apart also by people who see fewer colours (with dashes beyond eight). Green comes last: beside
 * verdicts it would say "healthy". */
export const SERIES = ["s1", "s2", "s6", "s4", "s5", "s7", "s8", "s3"] as const;
export const seriesColour = (place: number): string => SERIES[place % SERIES.length] ?? "s1";
