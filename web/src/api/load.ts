/** Data of a page: reloaded when its source changes or the server is back; the old data stay visible meanwhile. */
import { type Accessor, createEffect, createSignal, on, onCleanup } from "solid-js";
import { epoch } from "./connection";
import { sentenceOf } from "./problem";

export interface Load<T> {
  data: Accessor<T | undefined>;
  /** Why there are no data: one sentence. */
  error: Accessor<string | undefined>;
  loading: Accessor<boolean>;
  reload: () => void;
}

/** Loads whenever `source` returns another value; `undefined`: nothing to load. */
export function createLoad<S, T>(source: Accessor<S | undefined>, load: (source: S, signal: AbortSignal) => Promise<T>): Load<T> {
  const [data, setData] = createSignal<T>();
  const [error, setError] = createSignal<string>();
  const [loading, setLoading] = createSignal(false);
  const [again, setAgain] = createSignal(0);
  let control: AbortController | undefined;
  createEffect(
    on([source, epoch, again], ([wanted]) => {
      control?.abort();
      if (wanted === undefined) {
        setData(undefined);
        setError(undefined);
        setLoading(false);
        return;
      }
      const mine = new AbortController();
      control = mine;
      setLoading(true);
      load(wanted, mine.signal).then(
        (value) => {
          if (mine.signal.aborted) return;
          setData(() => value);
          setError(undefined);
          setLoading(false);
        },
        (reason: unknown) => {
          if (mine.signal.aborted) return;
          setError(sentenceOf(reason));
          setLoading(false);
        },
      );
    }),
  );
  onCleanup(() => control?.abort());
  return { data, error, loading, reload: () => setAgain((count) => count + 1) };
}
