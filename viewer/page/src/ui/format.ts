/** Numbers as text, with their units. */

/** Text of a value that is not known. */
export const UNKNOWN = "–";

/** Space that does not break, and is narrow: between groups of digits, and before units. */
const THIN_SPACE = "\u202f";

/** Return a number with a fixed count of decimals and a true minus sign; unknown if it is not finite. */
export function formatNumber(value: number | null | undefined, decimals = 0): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const text = value.toFixed(decimals);
  // No "-0.0": it flickers beside 0.0.
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
}

/** Return a number with its unit. */
export function formatValue(value: number | null | undefined, decimals: number, unit: string): string {
  const number = formatNumber(value, decimals);
  return number === UNKNOWN ? UNKNOWN : `${number}${THIN_SPACE}${unit}`;
}

/** Return an integer with its digits in groups of three. */
export function formatInteger(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const digits = Math.abs(Math.round(value)).toFixed(0);
  return `${value <= -0.5 ? "−" : ""}${digits.replace(/\B(?=(\d{3})+$)/g, THIN_SPACE)}`;
}

/** Return a volume given in [mm³] as a number of cubic metres, to the litre. */
export function formatVolume(mm3: number | undefined): string {
  if (mm3 === undefined || !Number.isFinite(mm3)) return UNKNOWN;
  const [whole = "0", decimals = "000"] = Math.abs(mm3 / 1e9).toFixed(3).split(".");
  const isZero = Number(whole) === 0 && Number(decimals) === 0;
  return `${mm3 < 0 && !isZero ? "−" : ""}${formatInteger(Number(whole))}.${decimals}`;
}

/** Return a time as 1:02:03.4, with hours if there are any; for the labels of a timeline. */
export function formatTime(seconds: number, decimals = 1): string {
  if (!Number.isFinite(seconds)) return UNKNOWN;
  const scale = 10 ** decimals;
  const total = Math.round(Math.max(seconds, 0) * scale) / scale;
  const hours = Math.floor(total / 3600);
  const minutes = Math.floor((total % 3600) / 60);
  const rest = (total % 60).toFixed(decimals).padStart(decimals > 0 ? decimals + 3 : 2, "0");
  return hours > 0 ? `${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}

/** Return a number of bytes. */
export function formatBytes(bytes: number): string {
  if (bytes < 1e6) return `${formatNumber(bytes / 1e3)}${THIN_SPACE}kB`;
  return `${formatNumber(bytes / 1e6, 1)}${THIN_SPACE}MB`;
}

export function degrees(radians: number | undefined): number | undefined {
  return radians === undefined ? undefined : (radians * 180) / Math.PI;
}

/** Return an angle between -π and π [rad], for joints that turn without limits. */
export function wrapAngle(angle: number): number {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}

/** Return a name from a file or topic as words: `left_track` as "Left track", `/excavator` as "Excavator". */
export function formatName(name: string): string {
  const words = name.replace(/^\/+/, "").replaceAll("_", " ").replaceAll("/", " / ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/** Return a message of the server as a sentence. */
export function sentence(text: string): string {
  const end = /[.!?]$/.test(text) ? "" : ".";
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}${end}`;
}
