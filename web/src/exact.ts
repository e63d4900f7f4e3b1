/** JSON with seeds as they are: a number beyond 2^53 would come out as another one, so that it becomes a text. */

/** A whole number of a key that ends in `seed`. In a text inside of the JSON the quotes are escaped, so that it is not found there. */
const SEED = /("(?:\w*_)?seed"\s*:\s*)(\d{16,})(?=\s*[,}\]])/g;

export const parseExact = (text: string): unknown => JSON.parse(text.replace(SEED, '$1"$2"'));

/** A body whose `seed` is digits, as JSON with the number they are. */
export const jsonWithSeed = (body: object): string => JSON.stringify(body).replace(/("seed":)"(\d+)"/, (_, key: string, digits: string) => key + String(BigInt(digits)));
