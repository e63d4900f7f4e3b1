/** Dark or light: as the system says, until somebody chooses. Pictures on a canvas ask here for their colours. */
import { createEffect, createSignal } from "solid-js";

export type Theme = "system" | "light" | "dark";
const KEY = "rotortwin.theme";
const system = matchMedia("(prefers-color-scheme: dark)");

const stored = (): Theme => {
  const value = localStorage.getItem(KEY);
  return value === "light" || value === "dark" ? value : "system";
};
const [theme, choose] = createSignal<Theme>(stored());
const [systemDark, setSystemDark] = createSignal(system.matches);
system.addEventListener("change", (event) => setSystemDark(event.matches));

/** What was chosen. */
export { theme };

/** Whether the page is dark now; pictures depend on it. */
export const dark = () => (theme() === "system" ? systemDark() : theme() === "dark");

export function setTheme(next: Theme): void {
  if (next === "system") localStorage.removeItem(KEY);
  else localStorage.setItem(KEY, next);
  choose(next);
}

/** Keeps the document's attribute in step. */
export function applyTheme(): void {
  createEffect(() => {
    if (theme() === "system") delete document.documentElement.dataset["theme"];
    else document.documentElement.dataset["theme"] = theme();
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
