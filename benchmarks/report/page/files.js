// Scenario files: the JSON that the package reads and writes, checked the same way and told in one sentence.

const GOAL_FIELDS = ["goal", "start", "waypoints", "obstacles", "start_offset", "start_turn", "position_tolerance", "heading_tolerance", "waypoint_radius"];
const PATH_FIELDS = ["path", "closed", "laps", "start", "start_offset", "start_turn", "corridor"];
// The word that a file has for its pose, and what it is asked within (m and rad), by the kind of the scenario.
const TOLERANCES = { goal: 0.1, dock: 0.05 };
const SHAPES = { circle: ["x", "y", "radius"], box: ["x", "y", "length", "width"], wall: ["x1", "y1", "x2", "y2"] };
const MOST_POINTS = 20000;
const MOST_OBSTACLES = 1000;
const FARTHEST = 1e5; // m

// A value as a sentence tells it: a long one is cut.
function quoted(value) {
  const text = value === undefined ? "missing" : JSON.stringify(value);
  return text.length > 60 ? `${text.slice(0, 58)}…` : text;
}

// What a text of JSON holds; an Error of its own, no SyntaxError, says which field an object has twice.
function parsed(text) {
  const content = JSON.parse(text);
  const open = []; // the fields of the objects around a place
  for (const [mark, key, colon] of text.matchAll(/"((?:[^"\\]|\\.)*)"\s*(:?)|[{}]/g)) {
    if (mark === "{") open.push(new Set());
    else if (mark === "}") open.pop();
    else if (colon) {
      const fields = open[open.length - 1];
      if (fields.has(key)) throw new Error(`field ${quoted(key)} is there twice`);
      fields.add(key);
    }
  }
  return content;
}

function onlyFields(content, known, whose = "") {
  for (const field of Object.keys(content)) if (!known.includes(field)) throw new Error(`${whose}field ${quoted(field)} is not known; the fields are ${known.join(", ")}`);
}

function asNumber(field, value, least = -FARTHEST, most = FARTHEST) {
  if (typeof value !== "number" || !Number.isFinite(value) || value < least || value > most) {
    throw new Error(`${field} is ${quoted(value)}; it must be a number from ${least} to ${most}`);
  }
  return value;
}

function asNumbers(field, value, count) {
  if (!Array.isArray(value) || value.length !== count) throw new Error(`${field} is ${quoted(value)}; it must be ${count} numbers`);
  return value.map((each, k) => asNumber(`${field}[${k}]`, each));
}

function asObstacle(field, value) {
  if (typeof value !== "object" || value === null || !Object.keys(SHAPES).includes(value.kind)) throw new Error(`${field}.kind is ${quoted(value ? value.kind : undefined)}; it must be circle, box or wall`);
  for (const name of SHAPES[value.kind]) if (!(name in value)) throw new Error(`field ${field}.${name} is missing`);
  const known = [...SHAPES[value.kind], "kind", "mass", "heading", "patrol"];
  onlyFields(value, known, `${field}: `);
  const of = (name, least) => asNumber(`${field}.${name}`, value[name], least);
  const mass = value.mass === undefined ? 0 : asNumber(`${field}.mass`, value.mass, 0);
  let shape;
  if (value.kind === "circle") shape = [of("x"), of("y"), 1, 0, 0, 0, of("radius", 1e-3), mass];
  else if (value.kind === "box") {
    const heading = value.heading === undefined ? 0 : of("heading");
    shape = [of("x"), of("y"), Math.cos(heading), Math.sin(heading), 0.5 * of("length", 1e-3), 0.5 * of("width", 1e-3), 0, mass];
  } else {
    const [dx, dy] = [of("x2") - of("x1"), of("y2") - of("y1")];
    const length = Math.hypot(dx, dy);
    if (!length) throw new Error(`${field}: both ends of the wall are one point`);
    shape = [0.5 * (value.x1 + value.x2), 0.5 * (value.y1 + value.y2), dx / length, dy / length, 0.5 * length, 0, 0, 0];
  }
  let patrol = [0, 0, 0, 0, 0, 0];
  if (value.patrol !== undefined && value.kind === "circle") {
    const told = value.patrol || {};
    const each = (name, least) => asNumber(`${field}.patrol.${name}`, told[name], least);
    patrol = [shape[0], shape[1], each("vx"), each("vy"), each("leg_time", 1e-3), told.phase === undefined ? 0 : each("phase", 0)];
    const [[x, y]] = obstaclesAt({ obstacles: [shape], patrols: [patrol] }, 0);
    [shape[0], shape[1]] = [x, y];
  }
  return { shape, patrol };
}

// The world of a file's text; an Error says what is wrong with it.
function worldOf(text, name) {
  let content;
  try {
    content = parsed(text);
  } catch (error) {
    if (!(error instanceof SyntaxError)) throw error;
    throw new Error(/^\s*[{[]/.test(text) ? `it is no JSON: ${error.message}` : "it is no scenario or data sheet (JSON) and no image");
  }
  if (typeof content !== "object" || content === null || Array.isArray(content)) throw new Error("it must hold one object {...}");
  const kinds = Object.keys(TOLERANCES).filter((each) => each in content);
  if (kinds.length > 1) throw new Error(`it has both the fields ${kinds.join(" and ")}; there must be one of them`);
  const [goal] = kinds;
  if (!goal && !("path" in content)) throw new Error("it has none of the fields goal, dock and path");
  if ("map" in content) throw new Error("it names a map, another file, which a page cannot open: python evaluate.py --path drives there");
  if ("path_file" in content) throw new Error("it names a table, another file, which a page cannot open: put its points into path");
  onlyFields(content, goal ? GOAL_FIELDS.map((field) => (field === "goal" ? goal : field)) : PATH_FIELDS);
  const number = (field, fallback, least, most) => (content[field] === undefined ? fallback : asNumber(field, content[field], least, most));
  const world = { name, family: "", tier: "", quantity: null, start_offset: number("start_offset", 0, 0), start_turn: number("start_turn", 0, 0, 7) };
  if (goal) return goalWorld(goal, content, world, number);
  if (!Array.isArray(content.path) || content.path.length < 2 || content.path.length > MOST_POINTS) throw new Error(`path must be a list of 2 to ${MOST_POINTS} points [x, y]`);
  let path = content.path.map((point, k) => asNumbers(`path[${k}]`, point, 2));
  let closed = content.closed === true;
  const [first, last] = [path[0], path[path.length - 1]];
  if (content.closed !== false && first[0] === last[0] && first[1] === last[1]) [path, closed] = [path.slice(0, -1), true];
  path.forEach(([x, y], k) => { if (k && x === path[k - 1][0] && y === path[k - 1][1]) throw new Error(`path points ${k - 1} and ${k} are the same`); });
  if (path.length < (closed ? 3 : 2)) throw new Error(`path has ${path.length} points; it needs ${closed ? 3 : 2}`);
  return { ...world, kind: "path", steps: 2400, path, closed, laps: closed ? number("laps", 1, 0, 1000) : 1, corridor: number("corridor", 1, 1e-3),
    start: content.start ? asNumbers("start", content.start, 3) : null };
}

function goalWorld(kind, content, world, number) {
  const list = (field, most) => {
    const value = content[field] === undefined ? [] : content[field];
    if (!Array.isArray(value) || value.length > most) throw new Error(`${field} must be a list of at most ${most}`);
    return value;
  };
  const each = list("obstacles", MOST_OBSTACLES).map((value, k) => asObstacle(`obstacles[${k}]`, value));
  return { ...world, kind, steps: 1200, goal: asNumbers(kind, content[kind], 3), start: content.start ? asNumbers("start", content.start, 3) : [0, 0, 0],
    waypoints: list("waypoints", MOST_OBSTACLES).map((point, k) => asNumbers(`waypoints[${k}]`, point, 2)),
    obstacles: each.map(({ shape }) => shape), patrols: each.some(({ patrol }) => patrol[4] > 0) ? each.map(({ patrol }) => patrol) : [],
    position_tolerance: number("position_tolerance", TOLERANCES[kind], 1e-6), heading_tolerance: number("heading_tolerance", TOLERANCES[kind], 1e-6, 7), waypoint_radius: number("waypoint_radius", 0.5, 1e-6) };
}

// The file of a world, as the package reads it.
function fileOf(world) {
  if (world.kind === "path") {
    const { path, closed, laps, start_offset, start_turn, corridor } = world;
    return JSON.stringify({ path, closed, ...(closed ? { laps } : {}), ...(world.start ? { start: world.start } : {}), start_offset, start_turn, corridor }) + "\n";
  }
  const obstacles = [...world.obstacles, ...(world.walls || [])].map(([x, y, cos, sin, l, w, radius, mass], k) => {
    const patrol = (world.patrols || [])[k];
    const weight = mass > 0 ? { mass } : {};
    if (l === 0 && w === 0) {
      if (!patrol || !(patrol[4] > 0)) return { kind: "circle", x, y, radius, ...weight };
      return { kind: "circle", x: patrol[0], y: patrol[1], radius, patrol: { vx: patrol[2], vy: patrol[3], leg_time: patrol[4], phase: patrol[5] } };
    }
    if (w === 0) return { kind: "wall", x1: x - l * cos, y1: y - l * sin, x2: x + l * cos, y2: y + l * sin };
    return { kind: "box", x, y, length: 2 * l, width: 2 * w, heading: Math.atan2(sin, cos), ...weight };
  });
  return JSON.stringify(Object.fromEntries(GOAL_FIELDS.map((field) => [field === "goal" ? world.kind : field, field === "obstacles" ? obstacles : world[field]])), null, 1) + "\n";
}
