// What stands in a world, and the robots in it.

const HULLS = {}; // m, by robot: the payload tells them
const BOXES = {}; // m, length, width and how far ahead the middle is of the hulls that are rectangles
const REACH = 5.0; // m, of the scan that is drawn
const BEAMS = 72;
const TOUCH = 0.15; // m, within which a robot that crashed was of what it hit

// A hull is its radius, or a rectangle of BOXES.
function tellHull(robot, hull) {
  if (Array.isArray(hull)) BOXES[robot] = hull;
  HULLS[robot] = Array.isArray(hull) ? 0.5 * Math.hypot(hull[0] + 2 * Math.abs(hull[2] || 0), hull[1]) : hull;
}

// Obstacles are [x, y, cos, sin, half_length, half_width, radius, mass], patrols [x, y, vx, vy, leg_time, phase].
function obstaclesAt(world, time) {
  if (!world.patrols || !world.patrols.length) return world.obstacles || [];
  return world.obstacles.map((obstacle, k) => {
    const [x, y, vx, vy, legTime, phase] = world.patrols[k];
    if (!(legTime > 0)) return obstacle;
    const elapsed = time + phase;
    const leg = Math.floor(elapsed / legTime);
    const along = leg % 2 ? legTime - (elapsed - leg * legTime) : elapsed - leg * legTime;
    return [x + along * vx, y + along * vy, ...obstacle.slice(2)];
  });
}

// And the walls of a map's outline.
function solidsAt(world, time) {
  const found = obstaclesAt(world, time);
  return world.walls ? [...found, ...world.walls] : found;
}

function distanceTo([ox, oy, cos, sin, halfLength, halfWidth, radius], x, y) {
  const u = Math.abs(cos * (x - ox) + sin * (y - oy)) - halfLength;
  const v = Math.abs(cos * (y - oy) - sin * (x - ox)) - halfWidth;
  const [a, b] = [Math.max(u, 0), Math.max(v, 0)];
  return Math.sqrt(a * a + b * b) + Math.min(Math.max(u, v), 0) - radius; // Math.hypot is slow
}

// The other bodies of an actor's run as obstacles, robots as large as it.
function bodiesAt(world, actor, k, hull) {
  const found = (actor.others || []).map(({ x, y }, j) => [x[Math.min(k, x.length - 1)], y[Math.min(k, y.length - 1)], 1, 0, 0, 0, world.bodies[j] ?? hull, 0]);
  return found.filter(([x]) => x < AWAY);
}

// The collisions of an actor's run: when, which robot of a team, and what it hit, as an obstacle and in words; of a recorded team nobody knows when.
function hitsOf(world, actor, hull) {
  const { x: { length }, hits = [], outcome, version, others = [] } = actor;
  const found = hits.length ? hits : outcome === "collision" && !(world.starts || []).length ? [[length - 1, 0]] : [];
  const key = `${version} ${found.length}`;
  if (actor.struck && actor.struck.key === key) return actor.struck.found;
  const struck = found.map(([k, row]) => {
    const all = [actor, ...others].map(({ x, y }) => [x, y].map((each) => each[Math.min(k, each.length - 1)]));
    const radius = (j) => (j && world.bodies[j - 1]) || hull;
    const patrols = world.patrols || [];
    const things = [...all.map(([x, y], j) => ({ shape: [x, y, 1, 0, 0, 0, radius(j), 0], what: j && world.bodies[j - 1] !== null ? "a person" : "a robot" })).filter(({ shape: [x] }, j) => j !== row && x < AWAY),
      ...solidsAt(world, k * DT).map((shape, j) => ({ shape, what: shape[4] > 0 && !shape[5] ? "a wall" : (patrols[j] || [])[4] > 0 ? "a moving obstacle" : "an obstacle" }))];
    const [x, y] = all[row];
    const [l, w, m = 0] = (!row && BOXES[actor.robot]) || [];
    const [c, s] = l ? [Math.cos(actor.heading[k]), Math.sin(actor.heading[k])] : [];
    const edge = l ? [-1, -0.5, 0, 0.5, 1].flatMap((a) => [[a, 1], [a, -1], [1, a], [-1, a]]).map(([a, b]) => [m + 0.5 * l * a, 0.5 * w * b]).map(([u, v]) => [x + c * u - s * v, y + s * u + c * v]) : [[x, y]];
    const gap = ({ shape }) => Math.min(...edge.map(([u, v]) => distanceTo(shape, u, v))) - (l ? 0 : hull);
    const [nearest] = things.map((each) => ({ ...each, gap: gap(each) })).sort((a, b) => a.gap - b.gap);
    return { k, row, ...(nearest && nearest.gap < TOUCH ? nearest : {}) };
  });
  actor.struck = { key, found: struck };
  return struck;
}

function clearanceAt(world, time, x, y, hull) {
  let least = Infinity;
  for (const obstacle of solidsAt(world, time)) least = Math.min(least, distanceTo(obstacle, x, y));
  return least - hull;
}

// The range along a direction: what is drawn, not what policies are given.
function rangeAlong(obstacles, x, y, dx, dy) {
  let least = REACH;
  for (const [ox, oy, cos, sin, l, w, r] of obstacles) {
    const [px, py] = [x - ox, y - oy];
    if (l === 0 && w === 0) {
      const b = px * dx + py * dy;
      const root = b * b - (px * px + py * py - r * r);
      if (root >= 0 && b < 0) least = Math.min(least, Math.max(-b - Math.sqrt(root), 0));
      continue;
    }
    // in the frame of a box: the slabs that it is cut from
    const [u, v] = [cos * px + sin * py, cos * py - sin * px];
    const [du, dv] = [cos * dx + sin * dy, cos * dy - sin * dx];
    const [iu, iv] = [1 / (du || 1e-12), 1 / (dv || 1e-12)];
    const enter = Math.max(Math.min((-l - u) * iu, (l - u) * iu), Math.min((-w - v) * iv, (w - v) * iv));
    const leave = Math.min(Math.max((-l - u) * iu, (l - u) * iu), Math.max((-w - v) * iv, (w - v) * iv));
    if (leave >= Math.max(enter, 0)) least = Math.min(least, Math.max(enter, 0));
  }
  return least;
}

// What a picture shows at first, and what of the world there is: of one that is much larger than what is done in it a square
// about that, as in the figures, elsewhere all of it.
const AWAY = 1e5; // m: who is not there

function boundsOf(world, actors) {
  const near = [];
  const all = [];
  const put = (to, x, y, a = 0, b = a) => to.push([x - a, y - b], [x + a, y + b]);
  for (const point of world.path || []) put(near, point[0], point[1], Math.min(world.corridor, 0.5));
  for (const point of [world.start, world.goal, ...(world.waypoints || [])]) if (point) put(near, point[0], point[1], 0.6);
  for (const { x, y } of actors) for (let k = 0; k < x.length; k += 10) put(near, x[k], y[k], 0.3);
  for (const { others } of actors) for (const { x, y } of others || []) if (x[0] < AWAY) put(near, x[0], y[0], 0.3);
  for (const [x, y] of [...(world.starts || []), ...(world.goals || [])]) put(near, x, y, 0.6);
  for (const [, x, y, toX, toY] of world.walks || []) { put(near, x, y, 0.3); put(near, toX, toY, 0.3); }
  for (const [x, y, cos, sin, l, w, r] of [...(world.obstacles || []), ...(world.walls || [])]) {
    put(all, x, y, Math.abs(cos) * l + Math.abs(sin) * w + r, Math.abs(sin) * l + Math.abs(cos) * w + r);
  }
  for (const [x, y, vx, vy, t] of world.patrols || []) if (t > 0) { put(all, x, y, 0.3); put(all, x + t * vx, y + t * vy, 0.3); }
  for (const point of near) all.push(point);
  if (!all.length) return { shown: [-1, -1, 1, 1], whole: [-1, -1, 1, 1] };
  const span = (points, k) => {
    let [low, high] = [Infinity, -Infinity];
    for (const point of points) { low = Math.min(low, point[k]); high = Math.max(high, point[k]); }
    return [low, high];
  };
  const grown = ([low, high]) => [low - 0.03 * (high - low) - 0.15, high + 0.03 * (high - low) + 0.15];
  const ends = [0, 1].map((k) => span(all, k));
  const [[x0, x1], [y0, y1]] = ends.map(grown);
  const whole = [x0, y0, x1, y1];
  if (!near.length) return { shown: whole, whole };
  const places = [0, 1].map((k) => span(near, k));
  const extent = Math.max(...places.map(([low, high]) => high - low));
  const half = extent / 2 + Math.max(extent / 3, 2);
  if (Math.max(...ends.map(([low, high]) => high - low)) <= 4 * half) return { shown: whole, whole };
  const [[left, right], [bottom, top]] = places.map(([low, high], k) => [Math.max((low + high) / 2 - half, k ? y0 : x0), Math.min((low + high) / 2 + half, k ? y1 : x1)]);
  return { shown: [left, bottom, right, top], whole };
}

function drawWorld(context, world, time, pixel, passed) {
  if (world.path && world.path.length) {
    context.beginPath();
    world.path.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    if (world.closed) context.closePath();
    context.strokeStyle = ink("--line");
    context.lineWidth = 2 * world.corridor;
    if (!world.goal) context.stroke(); // the run ends beyond it
    context.strokeStyle = ink("--path");
    context.lineWidth = 3 * pixel;
    context.stroke();
  }
  const own = world.obstacles ? world.obstacles.length - (world.own || 0) : 0; // the last ones were put there
  const solids = solidsAt(world, time);
  for (const walls of [false, true]) solids.forEach((obstacle, k) => { // walls over what stands there
    if ((obstacle[4] > 0 && !obstacle[5]) === walls) drawObstacle(context, obstacle, pixel, world.own && k >= own && k < own + world.own ? "--ink" : "--solid");
  });
  for (const [x, y, vx, vy, legTime] of world.patrols || []) if (legTime > 0) { // what moves, and how far
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + legTime * vx, y + legTime * vy);
    context.setLineDash([2 * pixel, 6 * pixel]);
    [context.strokeStyle, context.lineWidth] = [ink("--solid"), 2 * pixel];
    context.stroke();
    context.setLineDash([]);
  }
  (world.waypoints || []).forEach(([x, y], k) => k >= passed && ring(context, x, y, world.waypoint_radius, pixel));
  if (world.goal) {
    const [x, y, heading] = world.goal;
    ring(context, x, y, Math.max(world.position_tolerance, 4 * pixel), pixel);
    if (!(world.heading_tolerance < Math.PI)) return; // any heading will do
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + 0.45 * Math.cos(heading), y + 0.45 * Math.sin(heading));
    context.stroke();
  }
}

// Out of this a run by hand ends.
function drawEdge(context, [left, bottom, right, top], pixel) {
  [context.strokeStyle, context.lineWidth] = [ink("--fail"), 2 * pixel];
  context.setLineDash([8 * pixel, 6 * pixel]);
  context.strokeRect(left, bottom, right - left, top - bottom);
  context.setLineDash([]);
}

// Where one is to arrive, over the robots that are there already.
function drawStars(context, world, pixel) {
  const { goal } = world;
  if (!goal && starOf(world)) flag(context, ...starOf(world), 7 * pixel);
  for (const [x, y] of world.goals || []) flag(context, x, y, 5 * pixel); // of the other robots of a team
  if (goal) flag(context, goal[0], goal[1], 9 * pixel);
}

// The star of a scene, where it has one.
const starOf = ({ path, closed, goal }) => goal || (path && path[closed ? 0 : path.length - 1]);

// An arrow at the edge of a near picture to the star that it does not hold, and how far that is from a place.
function drawWay(context, view, world, pixel, from) {
  const [x, y] = starOf(world) || view.centre;
  const [cx, cy] = view.centre;
  const room = [view.width, view.height].map((side) => side / 2 - 24);
  const [dx, dy] = [(x - cx) / pixel, (y - cy) / pixel];
  const out = Math.max(Math.abs(dx) / room[0], Math.abs(dy) / room[1]);
  if (out <= 1.08) return;
  const [ax, ay] = [cx + (dx / out) * pixel, cy + (dy / out) * pixel];
  context.save();
  context.scale(pixel, -pixel);
  [context.font, context.textAlign, context.lineWidth, context.strokeStyle, context.fillStyle] = ["600 13px system-ui, sans-serif", "center", 4, ink("--paper"), ink("--goal")];
  for (const how of ["strokeText", "fillText"]) context[how](`${Math.round(Math.hypot(x - from[0], y - from[1]))} m`, ax / pixel, -ay / pixel + (dy < 0 ? -16 : 26));
  context.translate(ax / pixel, -ay / pixel);
  context.rotate(Math.atan2(-dy, dx));
  context.beginPath();
  for (const [a, b] of [[14, 0], [-8, 11], [-8, -11]]) context.lineTo(a, b);
  context.fill();
  context.restore();
}

function drawObstacle(context, [x, y, cos, sin, l, w, r, mass], pixel, colour = "--solid") {
  context.fillStyle = context.strokeStyle = ink(colour);
  context.beginPath();
  if (l === 0 && w === 0) {
    context.arc(x, y, r, 0, 2 * Math.PI);
    context.fill();
    return;
  }
  const corner = (a, b) => [x + a * l * cos - b * w * sin, y + a * l * sin + b * w * cos];
  for (const [a, b] of [[1, 1], [-1, 1], [-1, -1], [1, -1]]) context.lineTo(...corner(a, b));
  context.closePath();
  context.lineWidth = (w > 0 ? 1 : 3) * pixel;
  if (mass > 0) context.setLineDash([4 * pixel, 3 * pixel]);
  if (w > 0 && !(mass > 0)) context.fill();
  context.stroke();
  context.setLineDash([]);
}

function ring(context, x, y, radius, pixel) {
  context.strokeStyle = ink("--goal");
  context.lineWidth = 2 * pixel;
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.stroke();
}

function flag(context, x, y, size) {
  context.fillStyle = ink("--goal");
  context.beginPath();
  for (let k = 0; k < 10; k++) {
    const r = k % 2 ? 0.42 * size : size;
    const angle = Math.PI / 2 + (k * Math.PI) / 5;
    context.lineTo(x + r * Math.cos(angle), y + r * Math.sin(angle));
  }
  context.closePath();
  context.fill();
}

const LANES = [1, -1, 2, -2, 3, -3].map((each) => 2.2 * each); // px to the left of its way, so that equal ones do not hide each other

function drawActor(context, actor, k, hull, pixel, { chosen, faint, under, thin, mark, hits, lane = 0 }) {
  const last = Math.min(k, actor.x.length - 1);
  const colour = ink(colourName(actor.policy));
  const alpha = faint || actor.ghost || actor.stale || (k > last && !actor.outcome) ? 0.35 : 1; // what is not yet driven so far is a ghost too
  context.strokeStyle = colour;
  context.globalAlpha = thin && !chosen ? 0.4 * alpha : alpha;
  context.lineWidth = (chosen ? 3 : thin ? 1.2 : 2) * pixel;
  context.setLineDash(dashOf(actor.policy, actor.twin).split(" ").filter(Boolean).map((each) => each * pixel));
  context.beginPath();
  for (let i = 0; i <= last; i++) context.lineTo(actor.x[i] - lane * pixel * Math.sin(actor.heading[i]), actor.y[i] + lane * pixel * Math.cos(actor.heading[i]));
  context.stroke();
  context.setLineDash([]);
  const solid = under ? 0.2 * alpha : alpha;
  context.globalAlpha = solid;
  const [x, y, heading] = [actor.x[last], actor.y[last], actor.heading[last]];
  if (mark) { // a ring around whom the picture is about
    context.beginPath();
    context.arc(x, y, hull + 5 * pixel, 0, 2 * Math.PI);
    for (const [of, width] of [[ink("--paper"), 5], [colour, 2]]) { [context.strokeStyle, context.lineWidth] = [of, width * pixel]; context.stroke(); }
    context.lineWidth = 3 * pixel;
  }
  context.beginPath();
  if (BOXES[actor.robot]) {
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const [l, w, m = 0] = BOXES[actor.robot];
    const [a, d, b] = [m + l / 2, m - l / 2, w / 2];
    for (const [u, v] of [[a, b], [d, b], [d, -b], [a, -b]]) context.lineTo(x + c * u - s * v, y + s * u + c * v);
    context.closePath();
  } else context.arc(x, y, hull, 0, 2 * Math.PI);
  context.globalAlpha *= 0.25;
  context.fillStyle = colour;
  context.fill();
  context.globalAlpha = solid;
  context.stroke();
  if (chosen) { // light around its nose, which shows where it looks
    context.beginPath();
    context.arc(x, y, 0.95 * hull, 0, 2 * Math.PI);
    [context.fillStyle, context.globalAlpha] = [ink("--paper"), 0.6 * solid];
    if (!BOXES[actor.robot]) context.fill();
    [context.fillStyle, context.globalAlpha] = [colour, solid];
  }
  context.beginPath(); // its nose
  for (const [turn, far] of [[0, 1], [2.5, 0.8], [Math.PI, 0.25], [-2.5, 0.8]]) context.lineTo(x + far * hull * Math.cos(heading + turn), y + far * hull * Math.sin(heading + turn));
  context.fill();
  if (hits.some(({ row }) => !row) || (last === actor.x.length - 1 && actor.outcome && actor.outcome !== "success" && !actor.there)) failed(context, x, y, Math.max(0.7 * hull, 8 * pixel), pixel);
  context.globalAlpha = alpha;
  for (const { shape } of hits) if (shape && !shape[4]) drawHit(context, shape, alpha, pixel);
  context.globalAlpha = 1;
}

// Who was hit, where that was: others may be drawn by then.
function drawHit(context, [x, y, , , , , radius], alpha, pixel) {
  [context.strokeStyle, context.fillStyle, context.lineWidth] = [ink("--fail"), ink("--fail"), 3 * pixel];
  context.beginPath();
  context.arc(x, y, radius + 3 * pixel, 0, 2 * Math.PI);
  context.stroke();
  context.globalAlpha = 0.3 * alpha;
  context.fill();
  context.globalAlpha = alpha;
}

// Sentences at the foot of the picture; returns where their lines are, as `drawNames` has it.
function drawCaption(context, view, sentences, pixel) {
  context.save();
  context.scale(pixel, -pixel);
  [context.font, context.textAlign, context.lineWidth, context.strokeStyle, context.fillStyle] = ["13px system-ui, sans-serif", "left", 4, ink("--paper"), ink("--ink")];
  const room = view.width - 16;
  const lines = sentences.flatMap((each) => each.split(" ").reduce((found, word) => {
    const longer = found.length ? `${found[found.length - 1]} ${word}` : word;
    return found.length && context.measureText(longer).width <= room ? [...found.slice(0, -1), longer] : [...found, word];
  }, []));
  const [left, foot] = [view.centre[0] / pixel - view.width / 2 + 8, -view.centre[1] / pixel + view.height / 2 - 8];
  const places = lines.map((line, k) => {
    const [at, half] = [foot - 17 * (lines.length - 1 - k), context.measureText(line).width / 2];
    for (const how of ["strokeText", "fillText"]) context[how](line, left, at);
    return [left + half, at, half];
  });
  context.restore();
  return places;
}

// Who is who, beside the robots, clear of them and of other bodies; those on one spot are counted. A name without room is left out.
function drawNames(context, view, actors, k, hull, pixel, bodies, things, placed) {
  const [middle, height] = [view.centre[0] * view.pixels, -view.centre[1] * view.pixels];
  context.save();
  context.scale(pixel, -pixel);
  context.font = "600 13px system-ui, sans-serif";
  context.textAlign = "center";
  context.lineWidth = 4;
  const spots = [];
  const solid = [...bodies.map(([x, y, , , , , radius]) => [x, -y, radius]), ...actors.map(({ x, y }) => [x[Math.min(k, x.length - 1)], -y[Math.min(k, y.length - 1)], hull])];
  for (const { x, y, name, policy, outcome, top } of actors) {
    const last = Math.min(k, x.length - 1);
    if (k > last && !outcome) continue; // it waits
    const same = !top && spots.find((spot) => !spot.top && Math.hypot(spot.x - x[last], spot.y - y[last]) < hull);
    if (same) same.more += 1;
    else spots.push({ x: x[last], y: y[last], name: name.replace(/ \(.*\)/, ""), policy, top, more: 0 });
  }
  for (const { x, y, policy, more, ...spot } of spots) {
    const name = !more ? spot.name : policy === FRIEND ? `${spot.name} and ${more} more` : `${more + 1} robots`;
    const half = context.measureText(name).width / 2 + 4;
    const room = Math.max(view.width / 2 - half, 0);
    const rim = spot.top ? 6 : 0;
    const [above, below, aside] = [(-y - hull) / pixel - 6 - rim, (-y + hull) / pixel + 16 + rim, hull / pixel + half + 2 + rim];
    const places = [[0, above], [0, below], [aside, -y / pixel + 5], [-aside, -y / pixel + 5], ...[16, 32, 48].flatMap((off) => [[0, above - off], [0, below + off]])];
    const near = things.filter((each) => (each[5] || each[6]) && distanceTo(each, x, y) < 2 * half * pixel + hull + 80 * pixel); // but for thin walls
    const across = Array.from({ length: Math.ceil(half / 6) + 1 }, (_, n) => (2 * n / Math.ceil(half / 6) - 1) * half);
    const clear = (at, foot) => near.every((each) => across.every((off) => distanceTo(each, (at + off) * pixel, (5 - foot) * pixel) > 9 * pixel));
    const free = places.map(([dx, foot]) => [Math.min(Math.max(x / pixel + dx, middle - room), middle + room), foot])
      .find(([at, foot]) => Math.abs(foot - 5 - height) < view.height / 2 - 8 && placed.every(([px, py, ph]) => Math.abs(px - at) > ph + half || Math.abs(py - foot) >= 16)
        && solid.every(([bx, by, br]) => Math.hypot(Math.max(Math.abs(bx / pixel - at) - half + 4, 0), Math.max(Math.abs(by / pixel - foot + 4) - 6, 0)) >= br / pixel)
        && clear(at, foot));
    if (!free) continue;
    const [at, foot] = free;
    placed.push([at, foot, half]);
    const [dx, dy] = [x / pixel - at, 5 - y / pixel - foot];
    context.strokeStyle = ink(colourName(policy));
    if (Math.abs(dy) > hull / pixel + 24 + rim || Math.abs(dx) > hull / pixel + half + 6 + rim) { // far from its robot: a line leads there
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(at + Math.sign(dx) * Math.min(Math.abs(dx), half - 4), foot - 5 + Math.sign(dy) * 8);
      context.lineTo(x / pixel, -y / pixel);
      context.stroke();
      context.lineWidth = 4;
    }
    context.strokeStyle = ink("--paper");
    context.fillStyle = ink(colourName(policy));
    for (const how of ["strokeText", "fillText"]) context[how](name, at, foot);
  }
  context.restore();
}

// The other bodies of the run of an actor: robots as large as it, and people, with the goals of the robots.
function drawBodies(context, world, actor, k, hull, pixel) {
  const fallen = hitsOf(world, actor, hull).filter((each) => k >= each.k).map(({ row }) => row - 1);
  context.lineWidth = 1.5 * pixel;
  actor.others.forEach(({ x, y }, j) => {
    const at = Math.min(k, x.length - 1);
    if (at < 0 || x[at] > AWAY) return;
    const radius = world.bodies[j];
    context.strokeStyle = context.fillStyle = ink(radius === null ? colourName(actor.policy) : "--solid");
    context.beginPath();
    context.arc(x[at], y[at], radius === null ? hull : radius, 0, 2 * Math.PI);
    context.globalAlpha = 0.35;
    context.fill();
    context.globalAlpha = 1;
    context.stroke();
    if (radius !== null) return;
    const [gx, gy] = world.goals[j];
    context.beginPath();
    context.moveTo(x[at], y[at]);
    context.lineTo(gx, gy);
    context.setLineDash([2 * pixel, 4 * pixel]);
    context.stroke();
    context.setLineDash([]);
    if (fallen.includes(j) || (actor.outcome && k >= actor.x.length - 1)) failed(context, x[at], y[at], Math.max(0.7 * hull, 8 * pixel), pixel); // it is still there
    context.lineWidth = 1.5 * pixel;
  });
}

// A failure is marked where it happened, by a cross in a circle.
function failed(context, x, y, size, pixel) {
  context.strokeStyle = ink("--fail");
  context.lineWidth = 3 * pixel;
  context.beginPath();
  context.moveTo(x - size, y - size);
  context.lineTo(x + size, y + size);
  context.moveTo(x - size, y + size);
  context.lineTo(x + size, y - size);
  context.stroke();
}

function drawScan(context, solids, x, y, heading, pixel, colour) {
  const obstacles = solids.filter((each) => distanceTo(each, x, y) < REACH);
  context.strokeStyle = ink(colour);
  context.globalAlpha = 0.22;
  context.lineWidth = pixel;
  context.beginPath();
  for (let k = 0; k < BEAMS; k++) {
    const angle = heading - Math.PI + (k * 2 * Math.PI) / BEAMS;
    const [dx, dy] = [Math.cos(angle), Math.sin(angle)];
    const range = rangeAlong(obstacles, x, y, dx, dy);
    context.moveTo(x, y);
    context.lineTo(x + range * dx, y + range * dy);
  }
  context.stroke();
  context.globalAlpha = 1;
}
