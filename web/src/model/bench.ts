/** Tables of a thrust bench: what the browser can check before the server reads a file, and the server's findings. */

export interface BenchTable {
  name: string;
  text: string;
}

/** The server's limits: number of tables, and total bytes. */
export const MOST_TABLES = 16;
export const MOST_BYTES = 1 << 20;

/** A table from a file; UTF-8, or else Latin-1, as older spreadsheets write. A sentence if it is not a table. */
export function benchTable(file: string, bytes: Uint8Array): BenchTable | { problem: string } {
  if (bytes.length > MOST_BYTES) return { problem: `${file} has ${bytes.length.toLocaleString("en")} bytes; expected a table of at most ${MOST_BYTES.toLocaleString("en")}.` };
  if (bytes.includes(0)) return { problem: `${file} is no text; expected a table with a header and a row for each reading: export the sheet as CSV.` };
  const text = decoded(bytes);
  const { columns, rows } = shapeOf(text);
  if (columns.length < 2 || rows < 2) {
    return { problem: `${file}: ${columns.length} columns and ${rows} rows; expected a header and at least 2 rows, with commas, semicolons or tabs between throttle, thrust and the rest.` };
  }
  const name = file.normalize("NFKD").replace(/[^A-Za-z0-9._\- ()+]/g, "_").replace(/^[.\- ]+/, "").slice(-100);
  return { name: name || "table.csv", text };
}

function decoded(bytes: Uint8Array): string {
  try {
    return new TextDecoder("utf-8", { fatal: true }).decode(bytes);
  } catch {
    return new TextDecoder("windows-1252").decode(bytes);
  }
}

/** Column headers and the number of rows. */
export function shapeOf(text: string): { columns: string[]; rows: number } {
  const lines = text.split(/\r\n|\n|\r/).filter((line) => line.trim() !== "" && !line.trim().startsWith("#"));
  const head = lines[0] ?? "";
  const delimiter = [",", ";", "\t"].reduce((best, one) => (head.split(one).length > head.split(best).length ? one : best), ",");
  return { columns: head.split(delimiter).map((cell) => cell.trim()).filter(Boolean), rows: Math.max(0, lines.length - 1) };
}

/** Why the tables together are too large. */
export function tooMuch(tables: readonly BenchTable[]): string | undefined {
  if (tables.length > MOST_TABLES) return `${tables.length} tables; expected at most ${MOST_TABLES}.`;
  const bytes = tables.reduce((sum, one) => sum + new TextEncoder().encode(one.text).length, 0);
  return bytes > MOST_BYTES ? `The tables have ${bytes.toLocaleString("en")} bytes; expected at most ${MOST_BYTES.toLocaleString("en")} together.` : undefined;
}

/** Tables that were stored as text; none if it is not a list of them. */
export function tablesOf(kept: string): BenchTable[] {
  try {
    const found = JSON.parse(kept || "[]") as BenchTable[];
    return Array.isArray(found) ? found.filter((one) => typeof one.name === "string" && typeof one.text === "string") : [];
  } catch {
    return [];
  }
}

/** Removes the path at which a job stores a table. */
export const withoutPlace = (sentence: string) => sentence.replace(/\bbench\/\d+\//g, "");

/** Notes of a result: those about the bench, and the rest. */
export function benchNotes(notes: readonly string[]): { bench: string[]; rest: string[] } {
  const isBench = (note: string) => note.startsWith("bench ");
  return { bench: notes.filter(isBench).map((note) => withoutPlace(note.replace(/^bench /, ""))), rest: notes.filter((note) => !isBench(note)) };
}
