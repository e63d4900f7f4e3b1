/**
 * Requests to the server, typed by its OpenAPI document.
 *
 * A read without an answer waits for the server and is repeated. A write carries an `Idempotency-Key`, so that repeating it after a
 * lost answer cannot do the work twice. Every refusal is thrown as an [`ApiError`].
 */
import { parseExact } from "../exact";
import { back, lost } from "./connection";
import { ApiError, problemOf } from "./problem";
import { signedIn } from "./session";
import type { components, paths } from "./schema";

export type Schemas = components["schemas"];

type Method = "get" | "post" | "put" | "delete";
type Operation<P extends keyof paths, M extends Method> = paths[P] extends Record<M, infer O> ? O : never;
type Json<T> = T extends { content: { "application/json": infer B } } ? B : undefined;
type Answer<O> = O extends { responses: infer R }
  ? R extends { 200: infer A } ? Json<A> : R extends { 202: infer A } ? Json<A> : R extends { 201: infer A } ? Json<A> : undefined
  : never;
type Body<O> = O extends { requestBody: { content: { "application/json": infer B } } } ? B : undefined;
type Query<O> = O extends { parameters: { query?: infer Q } } ? Q : never;

/** Options of a request. */
interface Options {
  /** Values for `{name}` in the path. */
  path?: Record<string, string>;
  query?: object;
  signal?: AbortSignal;
}

/** Fills `{name}`s and appends the query. */
export function address(template: string, options: Options = {}): string {
  let url = template.replace(/\{(\w+)\}/g, (_, name: string) => {
    const value = options.path?.[name];
    if (value === undefined) throw new Error(`the address ${template} lacks ${name}`);
    return value.split("/").map(encodeURIComponent).join("/");
  });
  const query = new URLSearchParams();
  for (const [key, value] of Object.entries(options.query ?? {})) {
    if (value !== undefined && value !== null && value !== "") query.set(key, String(value));
  }
  const text = query.toString();
  if (text) url += `?${text}`;
  return url;
}

/** A unique key for each operation. */
export function freshKey(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** Retries until the server itself answers. */
async function send(url: string, init: RequestInit, what: string): Promise<Response> {
  for (;;) {
    let response: Response;
    try {
      response = await fetch(url, { credentials: "same-origin", ...init });
    } catch (error) {
      if (init.signal?.aborted) throw error;
      lost();
      await back();
      continue;
    }
    // Sent by an intermediary while the server is down: a proxy's 502 to 504, or an error without a body.
    if (response.status >= 500 && !(response.headers.get("content-type") ?? "").startsWith("application/problem+json")) {
      lost();
      await back();
      continue;
    }
    if (response.status === 401) {
      await signedIn();
      continue;
    }
    if (!response.ok) throw await problemOf(response, what);
    return response;
  }
}

/** Any request with a JSON answer. `T` is the caller's claim about its type; a body that is a string is JSON already. */
export async function ask<T>(method: string, url: string, body?: unknown, more: RequestInit = {}): Promise<T> {
  const headers: Record<string, string> = { accept: "application/json" };
  if (body !== undefined) headers["content-type"] = "application/json";
  if (method === "POST") headers["idempotency-key"] = freshKey();
  const init: RequestInit = { ...more, method, headers: { ...headers, ...(more.headers as Record<string, string> | undefined) } };
  if (body !== undefined) init.body = typeof body === "string" ? body : JSON.stringify(body);
  const response = await send(url, init, `${method} ${url}`);
  if (response.status === 204) return undefined as T;
  return parseExact(await response.text()) as T;
}

export function get<P extends keyof paths>(
  path: P,
  options: Omit<Options, "query"> & { query?: Query<Operation<P, "get">> & object } = {},
): Promise<Answer<Operation<P, "get">>> {
  return ask("GET", address(path, options), undefined, { signal: options.signal ?? null });
}

export function post<P extends keyof paths>(
  path: P,
  body: Body<Operation<P, "post">>,
  options: Options = {},
): Promise<Answer<Operation<P, "post">>> {
  return ask("POST", address(path, options), body, { signal: options.signal ?? null });
}

/** Creates or replaces a document. */
export async function putDocument(url: string, document: string): Promise<void> {
  await send(url, { method: "PUT", headers: { "content-type": "application/toml" }, body: document }, `PUT ${url}`);
}

/** Deletes the resource at an address. */
export async function remove(url: string): Promise<void> {
  await send(url, { method: "DELETE" }, `DELETE ${url}`);
}

/** A text, such as a TOML document. */
export async function text(url: string): Promise<string> {
  return (await send(url, {}, `GET ${url}`)).text();
}

/** How often an upload is sent whose connection breaks. */
const UPLOADS = 3;

/**
 * Uploads a file with progress, fraction 0 to 1. An upload that breaks is sent again when the server is back, one that meets an ended session
 * after the sign-in: always under the same key, so that it is taken once. `fetch` cannot report the progress of a body.
 */
export async function upload<T>(url: string, file: Blob, onProgress: (share: number) => void, signal?: AbortSignal): Promise<T> {
  const key = freshKey();
  for (let sent = 1; ; sent += 1) {
    const request = await sendFile(url, file, key, onProgress, signal);
    if (signal?.aborted) throw new ApiError(0, "The upload was canceled.");
    if (request.status === 401) {
      await signedIn();
      continue;
    }
    if (request.status >= 200 && request.status < 300) return parseExact(request.responseText) as T;
    const type = request.getResponseHeader("content-type") ?? "";
    // No answer, or one of an intermediary while the server is down.
    const broken = request.status === 0 || (request.status >= 500 && !type.startsWith("application/problem+json"));
    if (!broken) throw await problemOf(new Response(request.responseText, { status: request.status, headers: { "content-type": type } }), "The upload");
    lost();
    if (sent === UPLOADS) throw new ApiError(0, `The connection broke ${UPLOADS} times during the upload.`);
    onProgress(0);
    await back();
    // A server that turns an upload away early, because nobody is signed in, may break the connection before its answer is read.
    await send("/api/v1/limits", signal ? { signal } : {}, "GET /api/v1/limits");
  }
}

/** One try; resolves however it ends. */
function sendFile(url: string, file: Blob, key: string, onProgress: (share: number) => void, signal?: AbortSignal): Promise<XMLHttpRequest> {
  return new Promise((resolve) => {
    const request = new XMLHttpRequest();
    const stop = () => request.abort();
    request.open("POST", url);
    request.responseType = "text";
    request.setRequestHeader("content-type", "application/octet-stream");
    request.setRequestHeader("accept", "application/json");
    request.setRequestHeader("idempotency-key", key);
    request.upload.onprogress = (event) => event.lengthComputable && onProgress(event.loaded / event.total);
    request.onloadend = () => {
      signal?.removeEventListener("abort", stop);
      resolve(request);
    };
    signal?.addEventListener("abort", stop);
    request.send(file);
  });
}
