/** The server's size limits: a file that is too large is not sent. */
import { bytes } from "../format";
import { get } from "./client";
import { isUnknownAddress } from "./problem";

/** Why a log is too large to send; `judged`: to be judged immediately and not stored. */
export async function tooLarge(file: File, judged = false): Promise<string | undefined> {
  try {
    const limits = await get("/api/v1/limits");
    const most = judged ? limits.largest_judged_log : limits.largest_log;
    if (file.size <= most) return undefined;
    return `${file.name} (${bytes(file.size)}): this server takes logs of at most ${bytes(most)}${judged ? " here; drop it on the page Twin, and judge the imported log" : " (rotortwin serve --largest-upload)"}. Nothing was sent.`;
  } catch (error) {
    // An older server says so after the upload.
    if (isUnknownAddress(error)) return undefined;
    throw error;
  }
}
