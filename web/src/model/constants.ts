/** How well the constants of a vehicle are known: the `[[constant]]` tables of a model version, as the server writes them (TOML). */
import type { Estimate, Source } from "./identify";

const NUMBERS = ["value", "low", "high"] as const;
const TEXTS = ["key", "name", "unit", "source", "how", "better"] as const;
const SOURCES: readonly Source[] = ["entered", "stated", "log", "log-and-class", "parameter", "bench", "class", "assumed"];
const ESCAPES: Record<string, string> = { b: "\b", t: "\t", n: "\n", f: "\f", r: "\r", '"': '"', "\\": "\\" };

/** A string of one line, in either kind of quotes; undefined: it is none. */
function textOf(value: string): string | undefined {
  const literal = /^'([^']*)'$/.exec(value);
  if (literal) return literal[1];
  const basic = /^"((?:[^"\\]|\\.)*)"$/.exec(value);
  return basic?.[1]?.replace(/\\(?:u([0-9A-Fa-f]{4})|U([0-9A-Fa-f]{8})|(.))/g, (all, four, eight, one) =>
    one === undefined ? String.fromCodePoint(parseInt(four ?? eight, 16)) : (ESCAPES[one] ?? all),
  );
}

/**
 * The constants in the text of a version; none: it says nothing of them, and each is taken as exact.
 *
 * Throws where a table is not as the server writes it.
 */
export function constantsOf(version: string): Estimate[] {
  const found: Map<string, string>[] = [];
  let table: Map<string, string> | undefined;
  for (const line of version.split("\n")) {
    const text = line.trim();
    if (text.startsWith("[")) {
      table = text === "[[constant]]" ? new Map() : undefined;
      if (table) found.push(table);
    } else if (table && text !== "" && !text.startsWith("#")) {
      const entry = /^(\w+) = (.*)$/.exec(text);
      if (!entry) throw new Error(`a constant of the vehicle: expected \`key = value\`, got \`${text}\``);
      table.set(entry[1] ?? "", entry[2] ?? "");
    }
  }
  return found.map((entries, place) => {
    const wanted = (key: string): string => {
      const value = entries.get(key);
      if (value === undefined) throw new Error(`constant ${place + 1} of the vehicle has no \`${key}\``);
      return value;
    };
    const texts = TEXTS.map((key) => {
      const text = textOf(wanted(key));
      if (text === undefined) throw new Error(`constant ${place + 1} of the vehicle: \`${key}\` is no text of one line: ${wanted(key)}`);
      return [key, text] as const;
    });
    const numbers = NUMBERS.map((key) => {
      const value = Number(wanted(key).replaceAll("_", ""));
      if (!Number.isFinite(value)) throw new Error(`constant ${place + 1} of the vehicle: \`${key}\` is no number: ${wanted(key)}`);
      return [key, value] as const;
    });
    const one = Object.fromEntries([...texts, ...numbers]) as unknown as Estimate;
    if (!SOURCES.includes(one.source)) throw new Error(`constant ${place + 1} of the vehicle: \`source\` is ${one.source}, expected one of ${SOURCES.join(", ")}`);
    return one;
  });
}
