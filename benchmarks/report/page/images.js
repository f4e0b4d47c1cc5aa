// A picture as a map: what is dark stands there, as boxes that can be moved like any other.

const MOST_IMAGE = 160; // cells along the longer side
const [IMAGE_SIDE, LEAST_SIDE, MOST_SIDE] = [16, 2, 500]; // m, of the longer side
const ROOM_AROUND = 0.45; // m, from the way between start and goal to what stands there

// Rectangles [column, row, columns, rows] that cover what is occupied.
function rectangles(occupied, columns, rows) {
  const left = Uint8Array.from(occupied);
  const found = [];
  for (let r = 0; r < rows; r++) for (let c = 0; c < columns; c++) {
    if (!left[r * columns + c]) continue;
    let [w, h] = [1, 1];
    while (c + w < columns && left[r * columns + c + w]) w += 1;
    const full = (row) => { for (let k = 0; k < w; k++) if (!left[row * columns + c + k]) return false; return true; };
    while (r + h < rows && full(r + h)) h += 1;
    for (let a = 0; a < h; a++) left.fill(0, (r + a) * columns + c, (r + a) * columns + c + w);
    found.push([c, r, w, h]);
  }
  return found;
}

// The cells as far as possible from each other, by the way between them, that a hull has room in.
function farApart(occupied, columns, rows, reach) {
  const barred = new Uint8Array(columns * rows);
  for (let r = 0; r < rows; r++) for (let c = 0; c < columns; c++) {
    if (!occupied[r * columns + c]) continue;
    for (let a = Math.max(r - reach, 0); a <= Math.min(r + reach, rows - 1); a++) barred.fill(1, a * columns + Math.max(c - reach, 0), a * columns + Math.min(c + reach, columns - 1) + 1);
  }
  const walk = (from) => {
    const seen = new Uint8Array(columns * rows);
    const queue = [from];
    seen[from] = 1;
    for (let k = 0; k < queue.length; k++) {
      const [r, c] = [Math.floor(queue[k] / columns), queue[k] % columns];
      for (const [a, b] of [[r, c + 1], [r, c - 1], [r + 1, c], [r - 1, c]]) {
        const next = a * columns + b;
        if (a >= 0 && b >= 0 && a < rows && b < columns && !seen[next] && !barred[next]) { seen[next] = 1; queue.push(next); }
      }
    }
    return queue;
  };
  let most = [];
  const done = new Uint8Array(columns * rows);
  for (let k = 0; k < barred.length; k++) if (!barred[k] && !done[k]) {
    const queue = walk(k);
    for (const each of queue) done[each] = 1;
    if (queue.length > most.length) most = queue;
  }
  if (most.length < 2) return null;
  const first = most[most.length - 1];
  return [first, walk(first).pop()];
}

// The world of an image's pixels, RGBA row by row from the top; an Error says what is wrong with it.
function worldOfPixels({ data, width, height }, name, side = IMAGE_SIDE) {
  const [columns, rows] = [width, height];
  const cell = side / Math.max(columns, rows);
  const occupied = new Uint8Array(columns * rows);
  for (let k = 0; k < occupied.length; k++) {
    const [r, g, b, alpha] = data.subarray(4 * k, 4 * k + 4);
    occupied[k] = alpha > 127 && 0.299 * r + 0.587 * g + 0.114 * b < 128 ? 1 : 0;
  }
  const boxes = rectangles(occupied, columns, rows);
  if (!boxes.length) throw new Error("nothing in it is dark: dark is what stands there, light is free");
  if (boxes.length > MOST_OBSTACLES) throw new Error(`it has ${boxes.length} pieces; at most ${MOST_OBSTACLES} can stand in a scene: take a plainer picture`);
  const ends = farApart(occupied, columns, rows, Math.ceil(ROOM_AROUND / cell));
  if (!ends) throw new Error("a robot has no room in it: light is free");
  const place = (k) => [(k % columns + 0.5) * cell, (rows - Math.floor(k / columns) - 0.5) * cell];
  const [[x, y], [gx, gy]] = ends.map(place);
  const obstacles = boxes.map(([c, r, w, h]) => [(c + 0.5 * w) * cell, (rows - r - 0.5 * h) * cell, 1, 0, 0.5 * w * cell, 0.5 * h * cell, 0, 0]);
  return { name, family: "", tier: "", quantity: null, kind: "goal", steps: 2400, start: [x, y, Math.atan2(gy - y, gx - x)], goal: [gx, gy, 0], waypoints: [], obstacles, patrols: [],
    start_offset: 0, start_turn: 0, position_tolerance: TOLERANCES.goal, heading_tolerance: TOLERANCES.goal, waypoint_radius: 0.5, edited: true };
}

// The longer side (m) of a map of so many pixels, by the YAML file that belongs to it.
function sideOf(text, pixels) {
  const of = (field) => (new RegExp(`^${field}:\\s*(\\S+)`, "m").exec(text) || [])[1];
  if (Number(of("negate") ?? 0)) throw new Error(`negate is ${of("negate")}; here dark is what stands there, and it must be 0`);
  const side = Number(of("resolution")) * pixels;
  if (!(side >= LEAST_SIDE && side <= MOST_SIDE)) throw new Error(`resolution is ${quoted(of("resolution"))}; with ${pixels} pixels it must be from ${short(LEAST_SIDE / pixels)} to ${short(MOST_SIDE / pixels)} m`);
  return side;
}

// The pixels of an image file, as large as they are read.
async function pixelsOf(file) {
  let bitmap;
  try {
    bitmap = await createImageBitmap(file);
  } catch {
    throw new Error("it is no image that this browser reads; PNG and JPEG are");
  }
  const scale = Math.min(1, MOST_IMAGE / Math.max(bitmap.width, bitmap.height));
  const canvas = el("canvas", { width: Math.max(Math.round(scale * bitmap.width), 1), height: Math.max(Math.round(scale * bitmap.height), 1) });
  const context = canvas.getContext("2d");
  context.fillStyle = "#fff";
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  return Object.assign(context.getImageData(0, 0, canvas.width, canvas.height), { longest: Math.max(bitmap.width, bitmap.height) });
}
