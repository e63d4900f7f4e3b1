import { describe, expect, it } from "vitest";
import { MOST_BYTES, benchNotes, benchTable, shapeOf, tablesOf, tooMuch } from "./bench";

const bytes = (text: string) => new TextEncoder().encode(text);

describe("tables of a bench", () => {
  it("are read as text, whatever their letters", () => {
    const table = benchTable("Prüfstand 1.csv", bytes("ESC signal (µs),Thrust (gf)\n1050,15\n1145,37\n"));
    expect(table).toEqual({ name: "Pru_fstand 1.csv", text: "ESC signal (µs),Thrust (gf)\n1050,15\n1145,37\n" });
    const latin = benchTable("old.csv", Uint8Array.from([...bytes("signal ("), 0xb5, ...bytes("s),thrust\n1,2\n3,4\n")]));
    expect("text" in latin && latin.text).toContain("signal (µs)");
  });
  it("are refused with a sentence where they are none", () => {
    const problem = (file: string, content: Uint8Array) => {
      const found = benchTable(file, content);
      return "problem" in found ? found.problem : undefined;
    };
    expect(problem("picture.png", Uint8Array.from([0x89, 0x50, 0, 1]))).toMatch(/^picture.png is no text; expected/);
    expect(problem("words.txt", bytes("hello\nworld\nagain\n"))).toMatch(/1 columns and 2 rows; expected a header/);
    expect(problem("large.csv", new Uint8Array(MOST_BYTES + 1))).toMatch(/^large.csv has 1,048,577 bytes/);
    expect(tooMuch(Array.from({ length: 17 }, () => ({ name: "a", text: "" })))).toBe("17 tables; expected at most 16.");
  });
  it("have a shape", () => {
    expect(shapeOf("# stand\nthrottle [%];thrust [g]\n20;100\n30;200\n\n")).toEqual({ columns: ["throttle [%]", "thrust [g]"], rows: 2 });
  });
  it("are kept as text", () => {
    expect(tablesOf('[{"name":"a","text":"b"}]')).toEqual([{ name: "a", text: "b" }]);
    expect([tablesOf(""), tablesOf("{"), tablesOf("{}")]).toEqual([[], [], []]);
  });
  it("leave notes without the place where the job found them", () => {
    const notes = ["bench bench/0/stand.csv: no unit in the header: thrust (column `Thrust`) is taken as N", "60 s were used"];
    expect(benchNotes(notes)).toEqual({ bench: ["stand.csv: no unit in the header: thrust (column `Thrust`) is taken as N"], rest: ["60 s were used"] });
  });
});
