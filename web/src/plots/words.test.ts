import { describe, expect, it } from "vitest";
import { heatWords, laneWords } from "./words";

describe("pictures in words", () => {
  const where = (place: number) => `${5 * place} – ${5 * place + 5} s`;
  const row = (name: string, ...cells: (number | null)[]) => ({ name, cells, where });

  it("names the largest cells of a heat strip, and bounds the others", () => {
    expect(heatWords([row("a", 1, 2), row("b", null, 30), row("c", 0.9, null), row("d", 4, 3.25)])).toBe(
      "chi²/N of 4 channels; 1 is noise alone. Largest: b 30.0 at 5 – 10 s; d 4.00 at 0 – 5 s; a 2.00 at 5 – 10 s. The other 1 channel reaches 0.900 at most.",
    );
    expect(heatWords([row("a", 1, 2)])).toBe("chi²/N of 1 channel; 1 is noise alone. Largest: a 2.00 at 5 – 10 s.");
    expect(heatWords([row("a", null), row("b")])).toBe("No cell has a value that counts.");
    // The condition of a row has no such cell.
    expect(heatWords([row("a", -1, null)])).toContain("a −1.00 at 0 – 5 s");
  });

  it("says what a lane says, and when; what comes again by its number", () => {
    const verdict = { name: "verdict", stretches: [{ from: 0, to: 10, code: 0 }, { from: 10, to: 20, code: 3 }, { from: 20, to: 30, code: 0 }] };
    expect(laneWords([verdict, { name: "gap", stretches: [] }])).toBe("verdict: healthy 2 times, first at 0 s; rotor 3 from 10.00 to 20.00 s. gap: nothing.");
    const many = { name: "jumps", stretches: Array.from({ length: 8 }, (_, k) => ({ from: k, to: k + 0.5, code: -1 - k })), words: (code: number) => `jump ${-code}` };
    expect(laneWords([many])).toMatch(/jump 6 from 5\.000 to 5\.500 s; and 2 more\.$/);
  });
});
