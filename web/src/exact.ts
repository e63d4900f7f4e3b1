/** JSON with exact seeds: a number beyond 2^53 would be rounded, so it becomes a string. */

/** An integer under a key that ends in `seed`. In a string inside the JSON the quotes are escaped, so it does not match there. */
const SEED = /("(?:\w*_)?seed"\s*:\s*)(\d{16,})(?=\s*[,}\]])/g;

export const parseExact = (text: string): unknown => JSON.parse(text.replace(SEED, '$1"$2"'));

/** A body whose `seed` is a string of digits, as JSON with that number. */
export const jsonWithSeed = (body: object): string => JSON.stringify(body).replace(/("seed":)"(\d+)"/, (_, key: string, digits: string) => key + String(BigInt(digits)));
