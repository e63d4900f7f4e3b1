/** Campaigns: many flights with statistics of the detectors. */
import { Show, createSignal } from "solid-js";
import { type Schemas, ask } from "../api/client";
import { ApiError, sentenceOf } from "../api/problem";
import { Panel, Problem } from "../parts/bits";
import { navigate } from "../router";
import { type CampaignResult, CampaignView } from "../shown/campaign";
import { JobList, JobPage } from "./jobs";

export default function Campaigns(props: { id: string | undefined }) {
  return (
    <Show when={props.id} fallback={<JobList collection="campaigns" path="/campaigns" title="Campaigns" form={(reload) => <NewCampaign onSubmitted={reload} />} />} keyed>
      {(id) => (
        <JobPage<CampaignResult> collection="campaigns" path="/campaigns" id={id} counted="part" total={(facts) => facts["parts"] as number | undefined}>
          {(result) => <CampaignView result={result} />}
        </JobPage>
      )}
    </Show>
  );
}

function NewCampaign(props: { onSubmitted: () => void }) {
  const [name, setName] = createSignal("");
  const [text, setText] = createSignal("");
  const [refusal, setRefusal] = createSignal<ApiError>();
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    setRefusal(undefined);
    try {
      const job = await ask<Schemas["JobView"]>("POST", "/api/v1/campaigns", text().trim() ? { text: text() } : { campaign: name().trim() });
      props.onSubmitted();
      navigate(`/campaigns/${job.id}`);
    } catch (error) {
      setRefusal(error instanceof ApiError ? error : new ApiError(0, sentenceOf(error)));
    }
  };
  return (
    <Panel title="New campaign">
      <form class="stack" onSubmit={(event) => void submit(event)}>
        <div class="fields">
          <label class="field">Name of the library
            <input type="text" value={name()} placeholder="quad-lag" onInput={(event) => setName(event.currentTarget.value)} />
          </label>
          <button type="submit" class="main" disabled={!name().trim() && !text().trim()}>Fly</button>
        </div>
        <details>
          <summary>or a document of one's own (TOML)</summary>
          <textarea rows="10" spellcheck={false} aria-label="campaign document" value={text()} onInput={(event) => setText(event.currentTarget.value)} />
        </details>
        <Problem sentence={refusal()?.sentence} complaints={refusal()?.complaints} />
      </form>
    </Panel>
  );
}
