/** Other ways to start the same run: curl, Python and the command line. */
import { jsonWithSeed } from "../exact";

export interface Wish {
  scenario: string;
  /** A string of digits: a number would be rounded beyond 2^53. */
  seed: string | undefined;
  set: readonly string[];
  pace: "fast" | "real-time";
  link: "in-process" | "iceoryx2" | "zenoh";
  /** Name of a model that replaces the scenario's vehicle. */
  model?: string | undefined;
  /** Name of the model that the detectors use. */
  fdiModel?: string | undefined;
  /** Name of an autopilot listed by the operator, instead of our own controller; it determines pace and link. */
  autopilot?: string | undefined;
  /** Scenarios that only this server has under their names: no program knows them. */
  own?: boolean | undefined;
  /** The server asks for a token, which is never in the page: the texts take it from ROTORTWIN_TOKEN. */
  token?: boolean | undefined;
}

/** The body of `POST /runs`. */
export function submissionOf(wish: Wish) {
  return {
    scenario: wish.scenario,
    ...(wish.seed === undefined ? {} : { seed: wish.seed }),
    ...(wish.set.length > 0 ? { set: [...wish.set] } : {}),
    ...(wish.model ? { model: { model: wish.model } } : {}),
    ...(wish.fdiModel ? { fdi_model: { model: wish.fdiModel } } : {}),
    ...(wish.autopilot ? { controller: { autopilot: wish.autopilot } } : { pace: wish.pace, link: wish.link }),
  };
}

/** Quotes a word for a POSIX shell. */
export function quoted(word: string): string {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", `'\\''`)}'`;
}

export function asCurl(wish: Wish, origin: string): string {
  const token = wish.token ? ' -H "authorization: Bearer $ROTORTWIN_TOKEN"' : "";
  return `curl -s ${origin}/api/v1/runs${token} -H 'content-type: application/json' -d ${quoted(jsonWithSeed(submissionOf(wish)))}`;
}

export function asPython(wish: Wish, origin: string): string {
  const words: string[] = [JSON.stringify(wish.scenario)];
  if (wish.seed !== undefined) words.push(`seed=${wish.seed}`);
  if (wish.set.length > 0) words.push(`set=${JSON.stringify(wish.set)}`);
  if (wish.model) words.push(`model=${JSON.stringify({ model: wish.model })}`);
  if (wish.fdiModel) words.push(`fdi_model=${JSON.stringify({ model: wish.fdiModel })}`);
  if (wish.autopilot) words.push(`controller=${JSON.stringify({ autopilot: wish.autopilot })}`);
  else words.push(`pace=${JSON.stringify(wish.pace)}`, `link=${JSON.stringify(wish.link)}`);
  return [
    ...(wish.token ? ["import os", ""] : []),
    "from rotortwin import Client",
    "",
    `client = Client(${JSON.stringify(origin)}${wish.token ? ', token=os.environ["ROTORTWIN_TOKEN"]' : ""})`,
    `run = client.runs.submit(${words.join(", ")})`,
    "run = client.runs.wait(run.id, progress=True, check=True)",
    "print(run.run_hash)",
  ].join("\n");
}

/**
 * Models, autopilots and one's own scenarios belong to the server: with one of them the command flies there, and `@` marks its names.
 * Other scenarios are part of the program, which needs no server for them.
 */
export function asCommand(wish: Wish, origin: string): string {
  const there = Boolean(wish.own || wish.model || wish.fdiModel || wish.autopilot);
  const words = ["rotortwin", "fly", quoted(there ? `@${wish.scenario}` : wish.scenario)];
  if (wish.seed !== undefined) words.push("--seed", wish.seed);
  for (const one of wish.set) words.push("--set", quoted(one));
  if (wish.model) words.push("--model", quoted(`@${wish.model}`));
  if (wish.fdiModel) words.push("--fdi-model", quoted(`@${wish.fdiModel}`));
  if (wish.autopilot) words.push("--autopilot", quoted(wish.autopilot));
  else words.push("--pace", wish.pace, "--link", wish.link);
  if (there) words.push("--server", quoted(origin));
  return words.join(" ");
}
