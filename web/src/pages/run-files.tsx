/** Files of a run. */
import { For } from "solid-js";
import { get } from "../api/client";
import { createLoad } from "../api/load";
import { bytes } from "../format";
import { Loaded, Panel } from "../parts/bits";

export function RunFiles(props: { id: string }) {
  const files = createLoad(() => props.id, (id, signal) => get("/api/v1/runs/{id}/artifacts", { path: { id }, signal }));
  return (
    <Panel title="Files" note="for other programs">
      <Loaded load={files} what="the list of files">
        {(found) => (
          <div class="row">
            <For each={found().items}>{(file) => <a href={file.href} target="_blank" rel="noopener">{file.path} <span class="muted small">{bytes(file.size)}</span></a>}</For>
            <For each={["ulog", "mcap", "parquet", "csv"]}>
              {(format) => <a href={`/api/v1/runs/${props.id}/export?format=${format}`} download="">export as {format}</a>}
            </For>
          </div>
        )}
      </Loaded>
    </Panel>
  );
}
