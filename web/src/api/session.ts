/**
 * Sign-in: a token becomes a cookie that no script can read. The page never keeps the token.
 *
 * A request answered with 401 waits for [`signedIn`] and is repeated: no input is lost.
 */
import { createSignal } from "solid-js";
import { lost } from "./connection";
import { ApiError, problemOf, sentenceOf } from "./problem";

const [wanted, setWanted] = createSignal(false);
const [here, setHere] = createSignal(false);
let waiting: (() => void)[] = [];

/** True while the user must sign in. */
export { wanted as signInWanted };
/** True if this page has signed in. */
export { here as hasSignedIn };

/** Resolves after a sign-in. */
export function signedIn(): Promise<void> {
  setWanted(true);
  return new Promise((resolve) => waiting.push(resolve));
}

/** Exchanges a token for a cookie; returns a sentence on failure. */
export async function signIn(token: string): Promise<string | undefined> {
  try {
    const response = await fetch("/api/v1/session", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ token }) });
    if (!response.ok) throw await problemOf(response, "The sign-in");
  } catch (error) {
    if (!(error instanceof ApiError)) lost();
    return sentenceOf(error);
  }
  setWanted(false);
  setHere(true);
  const all = waiting;
  waiting = [];
  for (const resolve of all) resolve();
  return undefined;
}

/** Ends the session, and clears all data shown. */
export async function signOut(): Promise<void> {
  await fetch("/api/v1/session", { method: "DELETE" });
  location.reload();
}
