// The payload: zlib over [length of the JSON, the JSON, the packed trajectories], as text of seven bits a character.

const QUANTUM = 1e-3; // m and rad
const DT = 0.05; // s

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = text.charCodeAt(k);
  return bytes;
}

// Undoes `as_text` of the package.
function bytesOfText(text) {
  const bytes = new Uint8Array(Math.floor((7 * text.length) / 8));
  let [held, bits, at] = [0, 0, 0];
  for (let k = 0; k < text.length; k++) {
    held = ((held << 7) | (text.charCodeAt(k) & 127)) & 0x7fff;
    bits += 7;
    if (bits < 8) continue;
    bits -= 8;
    bytes[at++] = held >> bits;
  }
  return bytes;
}

async function inflated(bytes) {
  if (typeof DecompressionStream === "undefined") {
    throw new Error("this browser cannot unpack it: it has no DecompressionStream (Chrome 80, Firefox 113, Safari 16.4 have)");
  }
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function readPayload() {
  const bytes = await inflated(bytesOfText(document.getElementById("payload").textContent));
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const told = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  return { told, packed: bytes.subarray(4 + length) };
}

// Undoes `drives.packed`: folded second differences, a column after the other, in four planes of bytes.
function unpacked(packed, [at, steps, columns]) {
  const count = steps * columns;
  const found = [];
  for (let c = 0; c < columns; c++) {
    const column = new Float64Array(steps);
    let first = 0;
    let value = 0;
    for (let k = 0; k < steps; k++) {
      const i = at + c * steps + k;
      const folded = packed[i] + 256 * packed[i + count] + 65536 * packed[i + 2 * count] + 16777216 * packed[i + 3 * count];
      first += folded % 2 ? (folded + 1) / 2 : -folded / 2;
      value += first;
      column[k] = value * QUANTUM;
    }
    found.push(column);
  }
  // of worlds of several bodies x and y of each follow
  const others = columns > 4 ? Array.from({ length: (columns - 3) / 2 }, (_, k) => ({ x: found[3 + 2 * k], y: found[4 + 2 * k] })) : [];
  return { x: found[0], y: found[1], heading: found[2], error: columns === 4 ? found[3] : null, others };
}
