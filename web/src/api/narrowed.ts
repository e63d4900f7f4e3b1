/**
 * Answers of which the page knows more than the server's document says: pairs of numbers where it says arrays, an object where it says
 * anything. What the document does say holds: a field that it does not have, or that cannot be so, does not compile.
 */
type Fits<Wide, Narrow> = { [K in keyof Narrow]: K extends keyof Wide ? Wide[K] : never };

export type Narrowed<Wide, Narrow extends Fits<Wide, Narrow>> = Omit<Wide, keyof Narrow> & Narrow;
