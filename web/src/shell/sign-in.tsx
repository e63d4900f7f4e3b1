/** The sign-in form for a server with tokens. */
import { Show, createSignal } from "solid-js";
import { signIn, signInWanted } from "../api/session";
import { Problem } from "../parts/bits";

export function SignIn() {
  const [problem, setProblem] = createSignal<string>();
  const [busy, setBusy] = createSignal(false);
  const submit = async (event: SubmitEvent & { currentTarget: HTMLFormElement }) => {
    event.preventDefault();
    const form = event.currentTarget;
    const token = String(new FormData(form).get("token") ?? "");
    setBusy(true);
    setProblem(await signIn(token));
    form.reset();
    setBusy(false);
  };
  return (
    <Show when={signInWanted()}>
      <form class="away" aria-label="Sign in" onSubmit={(event) => void submit(event)}>
        <div class="fields">
          <label class="field">
            This server asks for an access token (rotortwin token create). What you typed stays.
            <input name="token" type="password" autocomplete="off" required autofocus />
          </label>
          <button type="submit" class="main" disabled={busy()}>Sign in</button>
        </div>
        <Problem sentence={problem()} />
      </form>
    </Show>
  );
}
