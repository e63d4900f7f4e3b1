/** What was typed into a form: it outlives a reload, a refusal and another page, and ends with the tab. */
import { type Accessor, createSignal } from "solid-js";

/** A text under a name; the same name on another page is the same text. The third function forgets it: what was typed has been sent. */
export function createTyped(name: string, initial = ""): [Accessor<string>, (text: string) => void, () => void] {
  const key = `rotortwin.typed.${name}`;
  const [text, setText] = createSignal(read(key) ?? initial);
  const kept = (keep: () => void) => {
    try {
      keep();
    } catch {
      // A browser that keeps nothing: the text stays as long as the page does.
    }
  };
  return [
    text,
    (next) => {
      setText(next);
      kept(() => sessionStorage.setItem(key, next));
    },
    () => kept(() => sessionStorage.removeItem(key)),
  ];
}

/** Whether something was typed under a name. */
export const isTyped = (name: string) => read(`rotortwin.typed.${name}`) !== null;

function read(key: string): string | null {
  try {
    return sessionStorage.getItem(key);
  } catch {
    return null;
  }
}
