/** Why a request was refused: the server's problem document, as an error with one sentence. */
export class ApiError extends Error {
  constructor(
    /** HTTP status; 0 if there was no answer. */
    readonly status: number,
    /** One sentence for the user. */
    readonly sentence: string,
    /** All errors in a document, if the server listed them. */
    readonly complaints: readonly string[] = [],
  ) {
    super(sentence);
  }
}

/** One sentence for any thrown value. */
export function sentenceOf(error: unknown): string {
  if (error instanceof ApiError) return error.sentence;
  if (error instanceof Error) return error.message;
  return String(error);
}

/** Reads a refusal; `what` names the request for answers that are not problem documents. */
export async function problemOf(response: Response, what: string): Promise<ApiError> {
  const type = response.headers.get("content-type") ?? "";
  if (type.startsWith("application/problem+json")) {
    const problem = (await response.json()) as { title?: string; detail?: string; complaints?: string[] };
    return new ApiError(response.status, problem.detail ?? problem.title ?? `status ${response.status}`, problem.complaints ?? []);
  }
  return new ApiError(response.status, `${what}: the server answered with status ${response.status} and no explanation.`);
}

/** True if the server does not know this address: an older version. */
export function isUnknownAddress(error: unknown): boolean {
  return error instanceof ApiError && (error.status === 404 || error.status === 405) && error.sentence.startsWith("nothing is served at");
}
