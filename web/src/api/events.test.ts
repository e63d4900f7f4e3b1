import { describe, expect, it } from "vitest";
import { EventParser } from "./events";

describe("EventParser", () => {
  it("puts events together whatever the pieces are", () => {
    const text = 'id: 1\nevent: queued\ndata: {}\n\n: keep alive\n\nid: 2\r\nevent: progress\r\ndata: {"a":\r\ndata: 1}\r\n\r\ndata: bare\n\n';
    for (const size of [1, 2, 3, 7, text.length]) {
      const parser = new EventParser();
      const found = [];
      for (let at = 0; at < text.length; at += size) found.push(...parser.push(text.slice(at, at + size)));
      const kinds = found.map((event) => [event.id, event.event, event.data]);
      if (size === text.length) {
        expect(kinds).toEqual([
          ["1", "queued", "{}"],
          ["2", "progress", '{"a":\n1}'],
          ["2", "message", "bare"],
        ]);
      }
      expect(found.at(0)?.event).toBe("queued");
      expect(found.at(-1)?.data).toBe("bare");
    }
  });
});
