// What the page carries: one JSON text, and arrays packed into one run of bytes.

async function unpacked(id) {
  const packed = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

const ARRAYS = { f8: Float64Array, f4: Float32Array, u4: Uint32Array };

/** Return the function that gives the array of a reference [type, first byte, number of values]. */
function reader(buffer) {
  return ([type, offset, length]) => new ARRAYS[type](buffer, offset, length);
}

let mark = "."; // decimal mark of the page's language

/** Return a number as text with about so many digits. */
function shown(x, digits = 4) {
  const size = Math.abs(x);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) return x.toExponential(Math.min(digits - 1, 3)).replace("-", "\u2212").replace(".", mark);
  return String(Number(x.toPrecision(digits))).replace("-", "\u2212").replace(".", mark);
}

/** Return what follows a number: its unit, of which only the sign of degrees comes without a space. */
function suffix(unit) {
  return unit && unit !== "\u00b0" ? ` ${unit}` : unit;
}

/** Return the round number, 1, 2 or 5 times a power of ten, next above another. */
function round(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return power * ([1, 2, 5].find((m) => m * power >= 0.999 * x) || 10);
}

/** Return round numbers from low to high, about as many as wanted but two at least, each with its text. */
function ticks(low, high, wanted) {
  const step = round((high - low) / wanted);
  const largest = Math.max(Math.abs(low), Math.abs(high));
  const digits = Math.min(9, 1 + Math.max(0, Math.floor(Math.log10(largest)) - Math.floor(Math.log10(step))));
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
    found.push({ place: k * step, text: shown(k * step, digits) });
  }
  return found.length > 1 ? found : ticks(low, high, 2 * wanted);
}
