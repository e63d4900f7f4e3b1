/** Campaigns: many flights with statistics of the detectors. */
import { For, Show, createSignal } from "solid-js";
import { type Schemas, ask, get } from "../api/client";
import { createLoad } from "../api/load";
import { ApiError, sentenceOf } from "../api/problem";
import { Panel, Problem } from "../parts/bits";
import { navigate, route, setQuery } from "../router";
import { type CampaignResult, CampaignView, DETECTORS, type Look } from "../shown/campaign";
import { CampaignFlights } from "./campaign-flights";
import { JobList, JobPage } from "./jobs";
import { createTyped } from "../typed";

export default function Campaigns(props: { id: string | undefined }) {
  return (
    <Show when={props.id} fallback={<JobList collection="campaigns" path="/campaigns" title="Campaigns" form={(reload) => <NewCampaign onSubmitted={reload} />} />} keyed>
      {(id) => (
        <JobPage<CampaignResult> collection="campaigns" path="/campaigns" title="Campaigns" id={id}>
          {(result) => <CampaignView result={result} look={look()} choose={choose} flights={<CampaignFlights id={id} look={look()} />} />}
        </JobPage>
      )}
    </Show>
  );
}

/** The current selection is in the address. */
function look(): Look {
  const query = route().query;
  const detector = DETECTORS.map(([key]) => key).find((key) => key === query.get("detector")) ?? "sequential";
  const [truth, verdicts] = [query.get("truth"), query.get("verdict")];
  return { detector, ...(truth !== null && verdicts !== null ? { truth: Number(truth), verdicts: verdicts.split(",").map(Number) } : {}) };
}
const choose = (look: Look) => setQuery({ detector: look.detector, truth: look.truth?.toString(), verdict: look.verdicts?.join(",") });

function NewCampaign(props: { onSubmitted: () => void }) {
  const known = createLoad(() => true, async (_, signal) => (await get("/api/v1/library/campaigns", { signal })).items);
  const [name, setName] = createTyped("campaign.name");
  const [text, setText, forgetText] = createTyped("campaign.text");
  const wasTyped = text() !== "";
  const [refusal, setRefusal] = createSignal<ApiError>();
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    setRefusal(undefined);
    try {
      const job = await ask<Schemas["JobView"]>("POST", "/api/v1/campaigns", text().trim() ? { text: text() } : { campaign: name().trim() });
      forgetText();
      props.onSubmitted();
      navigate(`/campaigns/${job.id}`);
    } catch (error) {
      setRefusal(error instanceof ApiError ? error : new ApiError(0, sentenceOf(error)));
    }
  };
  return (
    <Panel title="New campaign" note="hundreds of flights of one scenario with its settings varied: how often and how fast the detectors name a fault, and how often they are wrong">
      <form class="stack" onSubmit={(event) => void submit(event)}>
        <div class="fields">
          <label class="field">Campaign of the library
            <select value={name()} onChange={(event) => setName(event.currentTarget.value)}>
              <option value="">choose</option>
              <For each={known.data() ?? []}>{(one) => <option value={one.name} selected={one.name === name()}>{one.name}</option>}</For>
            </select>
          </label>
          <button type="submit" class="main" disabled={!name().trim() && !text().trim()}>Fly</button>
        </div>
        <Problem sentence={known.error() && `The campaigns of the library cannot be listed: ${known.error()}`} retry={known.reload} />
        <Show when={known.data()?.find((one) => one.name === name())?.description}>{(words) => <p class="small">{words()}</p>}</Show>
        <details open={wasTyped}>
          <summary>or your own document (TOML)</summary>
          <textarea rows="10" spellcheck={false} aria-label="campaign document" value={text()} onInput={(event) => setText(event.currentTarget.value)} />
        </details>
        <Problem sentence={refusal()?.sentence} complaints={refusal()?.complaints} />
      </form>
    </Panel>
  );
}
