/** Formatting of numbers, times and sizes. */

const SUPERSCRIPT: Record<string, string> = { "-": "⁻", "0": "⁰", "1": "¹", "2": "²", "3": "³", "4": "⁴", "5": "⁵", "6": "⁶", "7": "⁷", "8": "⁸", "9": "⁹" };

/** Three significant digits; "–" where there is no number. */
export function short(value: number | null | undefined, digits = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return power(value, digits);
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(size)));
  return value.toFixed(Math.min(decimals, 9)).replace(/^-/, "−");
}

function power(value: number, digits: number): string {
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const raised = String(Number(exponent)).replace(/./g, (letter) => SUPERSCRIPT[letter] ?? letter);
  return `${(mantissa ?? "").replace(/^-/, "−")}·10${raised}`;
}

/** `0.2497 ± 0.0011 N·s/m`: the interval to two digits, the value to the same place. */
export function plusMinus(value: number | null | undefined, half: number | null | undefined, unit: string): string {
  const ending = unit && unit !== "1" ? ` ${unit}` : "";
  if (typeof value !== "number" || typeof half !== "number" || !(half > 0) || !Number.isFinite(value)) return `${short(value)}${ending}`;
  const size = Math.max(Math.abs(value), half);
  const exponent = size >= 1e5 || size < 1e-3 ? Math.floor(Math.log10(size)) : 0;
  const scale = 10 ** exponent;
  const decimals = Math.min(9, Math.max(0, 1 - Math.floor(Math.log10(half / scale))));
  const text = `${(value / scale).toFixed(decimals).replace(/^-/, "−")} ± ${(half / scale).toFixed(decimals)}`;
  if (exponent === 0) return text + ending;
  const raised = String(exponent).replace(/./g, (letter) => SUPERSCRIPT[letter] ?? letter);
  return `(${text})·10${raised}${ending}`;
}

/** Share as percent. */
export function percent(share: number | null | undefined, decimals = 1): string {
  if (share === null || share === undefined || !Number.isFinite(share)) return "–";
  return `${(100 * share).toFixed(decimals)} %`;
}

/** `3 min 5 s`. */
export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  if (seconds > 0 && seconds < 0.1) return `${short(1000 * seconds, 2)} ms`;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 100) return `${seconds.toFixed(0)} s`;
  // Rounded first: 239.7 s are not "3 min 60 s".
  const whole = Math.round(seconds);
  const minutes = Math.floor(whole / 60);
  if (minutes < 60) return `${minutes} min ${whole % 60} s`;
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** `12.3 MB`. */
export function bytes(count: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = count;
  let place = 0;
  while (value >= 1000 && place < units.length - 1) {
    value /= 1000;
    place += 1;
  }
  return `${place === 0 ? value : value.toPrecision(3)} ${units[place] ?? ""}`;
}

/** Date and time in the user's time zone. */
export function moment(ms: number | null | undefined): string {
  if (ms === null || ms === undefined) return "–";
  const date = new Date(ms);
  const two = (value: number) => String(value).padStart(2, "0");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())} ${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
}

/** A verdict code of the telemetry in words. */
export function verdictText(code: number | null | undefined): string {
  if (code === null || code === undefined) return "–";
  if (code === -4) return "cannot judge";
  if (code === -3) return "ambiguous";
  if (code === -2) return "not ready";
  if (code === -1) return "unknown fault";
  if (code === 0) return "healthy";
  if (code >= 100) return `rotors ${Math.floor(code / 100)} and ${code % 100}`;
  return `rotor ${code}`;
}

/** "1 row", "2 rows". */
export function count(value: number, one: string, many = `${one}s`): string {
  return `${value.toLocaleString("en")} ${value === 1 ? one : many}`;
}
