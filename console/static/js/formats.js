// How numbers, names, sizes and times are written in tables.

export const number = (value, digits) => (value === null ? "" : value.toFixed(digits));
// A number as it was typed: with all its digits, but for those of a division.
const typed = (value) => (value === null ? "" : String(Number(value.toPrecision(12))));
// Where a trial's object stood: mm along y, and what else there is; older logs know of no more than that.
export const shift = (trial) => [typed(trial.displacement_mm), trial.displacement_x_mm && `x ${typed(trial.displacement_x_mm)}`, trial.yaw_deg && `${typed(trial.yaw_deg)}\u00b0`].filter(Boolean).join(", ");
export const plain = (value) => (value === null ? "" : String(value).replaceAll("_", " "));

// A line with names as people know them: "rice box"; file names stay.
export const named = (text) => text.replace(/\b[a-z]+(?:_[a-z0-9]+)+\b(?![-.]\w)/g, (name) => name.replaceAll("_", " "));

export function size(bytes) {
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(0)} kB`;
  return bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}

export function when(seconds) {
  const date = new Date(seconds * 1000);
  const two = (value) => String(value).padStart(2, "0");
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  return `${day} ${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
}
