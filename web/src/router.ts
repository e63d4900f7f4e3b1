/** Addresses of the page: the path names the page, the query its state. Nothing is stored elsewhere, so that a link is the state. */
import { createSignal } from "solid-js";

function here() {
  return { path: location.pathname.replace(/\/+$/, "") || "/", query: new URLSearchParams(location.search) };
}

const [route, setRoute] = createSignal(here());
window.addEventListener("popstate", () => setRoute(here()));

/** The current address. */
export { route };

/** Goes to an address of the page. */
export function navigate(url: string, replace = false): void {
  if (url === location.pathname + location.search) return;
  if (replace) history.replaceState(null, "", url);
  else history.pushState(null, "", url);
  const before = route().path;
  setRoute(here());
  if (route().path !== before) window.scrollTo(0, 0);
}

/** Changes parts of the query; `undefined` removes one. */
export function setQuery(parts: Record<string, string | string[] | undefined>, replace = false): void {
  const query = new URLSearchParams(location.search);
  for (const [key, value] of Object.entries(parts)) {
    query.delete(key);
    if (value === undefined || value === "") continue;
    for (const one of Array.isArray(value) ? value : [value]) query.append(key, one);
  }
  const text = query.toString();
  navigate(location.pathname + (text ? `?${text}` : ""), replace);
}

/** Follows a click on an internal link without reloading the page. */
export function followLinks(event: MouseEvent): void {
  if (event.defaultPrevented || event.button !== 0 || event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
  const link = (event.target as Element | null)?.closest("a");
  if (!link || link.target || link.hasAttribute("download") || link.origin !== location.origin) return;
  if (/^\/(api|assets|healthz|readyz|metrics)/.test(link.pathname) || link.getAttribute("href")?.startsWith("#")) return;
  event.preventDefault();
  navigate(link.pathname + link.search);
}
