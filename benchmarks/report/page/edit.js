// Edits the scene: things are moved, resized and turned by their handles, drawn by a drag, and paths by a pen.

const TOOLS = { move: "move", disc: "disc", box: "box", wall: "wall", path: "path", remove: "delete" };
const HINTS = { move: "Drag things; the small squares resize and turn them.", disc: "Click or tap where a disc is to stand; drag for a larger one.", box: "Click or tap where a box is to stand, or drag from corner to corner.",
  wall: "Click or tap where a wall is to stand, or drag from end to end.", path: "Draw a line in the empty field: all controllers follow it when you let go. Then put things in its way; what stood here is put away.", remove: "Click or tap what is to go." };
const AGAIN = { ...Object.fromEntries(["disc", "box", "wall"].map((each) => [each, `The run is computed anew, from the start. Click or tap for another ${each}.`])), path: "The grey band is the allowed width: leave it and the run ends. Tracks that lie on top of each other are moved a little apart. Draw another line as you like." };
const BY_KEYS = " Arrow keys move the cross (Shift: farther), Enter starts, Enter again ends, Escape leaves.";
const CLICKED = 0.3; // m, from the middle to the edges of what a click puts down
const SPACING = 0.1; // m between the points of a drawn path

const rounded = (point) => point.map((each) => Math.round(1000 * each) / 1000); // to mm: links stay short

// A drawn line as a path: its points evenly spaced, corners cut, closed where it comes back to its beginning.
function drawnPath(points) {
  const length = (line) => line.slice(1).reduce((sum, [x, y], k) => sum + Math.hypot(x - line[k][0], y - line[k][1]), 0);
  if (points.length < 2 || length(points) < 0.5) return null;
  const [first, last] = [points[0], points[points.length - 1]];
  const closed = length(points) > 3 && Math.hypot(last[0] - first[0], last[1] - first[1]) < 0.4;
  let line = spaced(points, SPACING);
  for (let round = 0; round < 4; round++) line = line.map(([x, y], k) => {
    const [a, b] = closed ? [line[(k + line.length - 1) % line.length], line[(k + 1) % line.length]] : [line[k - 1], line[k + 1]];
    return a && b ? [0.5 * x + 0.25 * (a[0] + b[0]), 0.5 * y + 0.25 * (a[1] + b[1])] : [x, y];
  });
  line = spaced(line, SPACING);
  const [p, q] = [line[0], line[line.length - 1]];
  if (closed && Math.hypot(p[0] - q[0], p[1] - q[1]) < 0.5 * SPACING) line = line.slice(0, -1);
  return { path: line.map(rounded), closed };
}

function spaced(points, spacing) {
  const found = [points[0]];
  let left = spacing;
  for (let k = 1; k < points.length; k++) {
    let [ax, ay] = points[k - 1];
    const [bx, by] = points[k];
    let rest = Math.hypot(bx - ax, by - ay);
    while (rest >= left && rest > 0) {
      [ax, ay] = [ax + ((bx - ax) * left) / rest, ay + ((by - ay) * left) / rest];
      rest -= left;
      left = spacing;
      found.push([ax, ay]);
    }
    left -= rest;
  }
  const [x, y] = points[points.length - 1];
  const [lx, ly] = found[found.length - 1];
  if (Math.hypot(x - lx, y - ly) > 0.3 * spacing) found.push([x, y]);
  return found;
}

// A path as a scene that things can stand in: places within half a metre of which robots pass, one after the other.
function lined({ path, closed }) {
  const line = closed ? [...path, path[0]] : path;
  const along = ([ax, ay], [bx, by]) => Math.atan2(by - ay, bx - ax);
  return { kind: "goal", name: "drawn", family: "", tier: "", quantity: null, steps: 2400, path, closed, corridor: 1, start: [...line[0], along(...line)], start_offset: 0, start_turn: 0,
    goal: [...line[line.length - 1], along(...line.slice(-2))], waypoints: spaced(line, 1).slice(1, -1).map(rounded), waypoint_radius: 0.5, obstacles: [], patrols: [], position_tolerance: 0.2, heading_tolerance: Math.PI, edited: true };
}

const shapeOf = {
  disc: ([ax, ay], [bx, by]) => [ax, ay, 1, 0, 0, 0, CLICKED + Math.hypot(bx - ax, by - ay), 0],
  box: ([ax, ay], [bx, by]) => [0.5 * (ax + bx), 0.5 * (ay + by), 1, 0, Math.max(0.5 * Math.abs(bx - ax), 0.05), Math.max(0.5 * Math.abs(by - ay), 0.05), 0, 0],
  wall: ([ax, ay], [bx, by]) => {
    const length = Math.max(Math.hypot(bx - ax, by - ay), 0.1);
    const [c, s] = [(bx - ax) / length || 0, (by - ay) / length || 0];
    return [0.5 * (ax + bx), 0.5 * (ay + by), ...(c || s ? [c, s] : [1, 0]), 0.5 * length, 0, 0, 0];
  },
};

// What has to be free and has a thing on it, in words; "" where the thing stands well.
function standsOn(shape, { start, goal, starts = [], goals = [], waypoints = [], walks = [] }, robot) {
  const on = (pose) => pose && distanceTo(shape, pose[0], pose[1]) < (HULLS[robot] || 0.25);
  return on(start) || starts.some(on) ? "where a robot starts" : on(goal) ? "on the star" : goals.some(on) ? "where another robot is to arrive" : waypoints.some(on) ? "on a place that robots must pass (a ring)" : walks.some(([, x, y]) => on([x, y])) ? "where a person starts" : "";
}

class Editor {
  constructor(drive) {
    this.drive = drive;
    this.replay = drive.replay;
    this.tool = null;
    this.handle = null; // what was grabbed last
    this.past = []; // the scenes before each change
    this.buttons = Object.fromEntries(Object.entries(TOOLS).map(([tool, text]) => [tool, button(text, (event) => {
      if (tool === "remove" && this.tool === "move" && this.handle && this.handle.kind === "obstacle") this.remove(); // the one that was chosen
      else this.take(this.tool === tool ? null : tool, !event.detail);
    }, { "aria-pressed": "false" })]));
    this.file = el("input", { type: "file", accept: ".json,application/json,image/*,.yaml,.yml", multiple: true, class: "hidden", tabindex: "-1", "aria-label": "scenario, image of a map or robot's data sheet", on: { change: () => this.load([...this.file.files]) } });
    this.part = el("details", {}, el("summary", {}, "Edit the scene"), el("div", { class: "files" }, Object.values(this.buttons)),
      el("div", { class: "files" }, button("reset scene", () => this.undo())));
    this.files = [button("save scenario", () => this.save()), button("open scenario, map or robot", () => this.file.click()), this.file];
    this.replay.overlay = (context, pixel) => this.marks(context, pixel);
    this.cross = null; // m, where the keys have led
    this.replay.grab = (event) => {
      const taken = this.tool !== null && this.grab(this.replay.view.metres(event), event.pointerType === "touch" ? 22 : 10);
      if (taken) this.replay.canvas.setPointerCapture(event.pointerId);
      return taken;
    };
    this.replay.drag = (event) => this.drag(this.replay.view.metres(event));
    this.replay.edits = (event) => this.key(event);
    this.replay.drop = () => this.dropped();
    this.replay.letGo = () => this.letGo();
    const { board } = this.replay;
    board.addEventListener("dragover", (event) => { event.preventDefault(); board.classList.add("drop"); });
    board.addEventListener("dragleave", () => board.classList.remove("drop"));
    board.addEventListener("drop", (event) => { event.preventDefault(); board.classList.remove("drop"); this.load([...event.dataTransfer.files]); });
  }

  say(text) {
    this.drive.result.textContent = text;
  }

  // Chooses a tool, or none; `keys` tells how to use it without a mouse, `stays` keeps it until one does something else.
  take(tool, keys = false, stays = tool in shapeOf) {
    let first = "";
    if (tool && tool !== "path" && tool !== "move" && this.replay.world.kind === "path") {
      const { length } = this.drive.runs.filter(({ tape }) => !tape.length); // not those by hand
      this.open(lined(this.replay.world), "They head for points of your line, by short cuts.");
      this.drive.go(false);
      for (const label of this.drive.race.rivals()) if (label !== this.drive.who.value) this.drive.add({ label }, false);
      first = `Your line followers (${length}) cannot dodge, so ${this.drive.runs.length} robots that can have taken their place. `;
    }
    this.tool = tool;
    this.stays = stays;
    this.keys = keys;
    this.cross = this.grabbed = null;
    this.replay.blank = stays && tool === "path"; // nothing that stands there has to do with the line
    for (const [name, each] of Object.entries(this.buttons)) each.setAttribute("aria-pressed", name === tool);
    this.say("");
    const { canvas, hint } = this.replay;
    canvas.classList.toggle("held", tool !== null); // a finger that edits does not scroll
    canvas.classList.toggle("draws", tool !== null && tool !== "move");
    this.drive.race.told = ""; // what was said of the end of runs
    this.tell(first + HINTS[tool]);
    if (keys && tool !== null) {
      this.cross = [...this.replay.view.centre];
      canvas.focus({ preventScroll: true });
    }
    if (tool !== null) for (const each of [canvas, this.replay.words]) each.scrollIntoView({ block: "nearest" }); // on a phone the tools lie below the picture
    this.replay.refresh();
    this.drive.race.tellScene();
  }

  // What the tool does, or nothing.
  tell(text) {
    const { hint } = this.replay;
    hint.hidden = this.tool === null;
    hint.classList.toggle("long", `${text}${this.keys ? BY_KEYS : ""}`.length > 0.6 * LONG_LINE);
    hint.replaceChildren(...(this.tool === null ? [] : [text + (this.keys ? BY_KEYS : ""), this.past.length ? button("undo last", () => this.takeBack()) : null, button("done", () => this.done())].filter(Boolean)));
  }

  // Where a path was to be drawn and was not, somebody drives in the scene that was there.
  done() {
    this.take(null);
    if (!this.drive.runs.length) this.drive.go(false);
  }

  // Without a mouse: arrows move a cross, Enter is the button of the mouse.
  key({ key, shiftKey }) {
    if (!this.tool) return false;
    const { replay } = this;
    const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key] || [0, 0];
    if (dx || dy) {
      const [x, y] = this.cross || replay.view.centre;
      const step = (shiftKey ? 50 : 10) / replay.view.pixels;
      this.cross = replay.view.within([x + step * dx, y + step * dy]);
      this.drag(this.cross);
    } else if (key === "Escape") this.done();
    else if (key === "Enter" || key === " ") {
      if (this.grabbed) this.dropped();
      else this.grab(this.cross || replay.view.centre, 10);
    } else return false;
    replay.refresh();
    return true;
  }

  change(apply) {
    const { replay, drive } = this;
    if (replay.world === drive.original) {
      replay.world = structuredClone(drive.original);
      delete replay.world.made; // what was moved by hand stays there for every hull
      delete replay.world.closing;
      replay.world.edited = true;
      for (const actor of replay.actors) if (actor.told) actor.ghost = true;
      this.about = replay.told_of.textContent;
      replay.told_of.textContent = `${drive.original.path && drive.original.kind === "goal" ? `${this.about} ` : ""}A scene that you changed; “reset scene”, under “Edit the scene”, brings it back.`; // short cuts stay told
      replay.listActors();
    }
    const { world } = replay;
    apply(world);
    if (world.path && world.kind === "goal") world.waypoints = lined(world).waypoints.filter(([x, y]) => world.obstacles.every((each) => distanceTo(each, x, y) > 0.5)); // those that a robot can stand on
    drive.world = world;
  }

  undo() {
    const { replay, drive } = this;
    if (this.tool === "remove") this.take(null);
    if (replay.world === drive.original) return;
    replay.world = drive.world = drive.original;
    for (const actor of replay.actors) actor.ghost = false;
    [this.handle, this.past] = [null, []];
    this.say("");
    if (this.about) replay.told_of.textContent = this.about;
    this.tell(HINTS[this.tool]);
    this.restarted();
    replay.listActors();
    drive.race.tellScene();
  }

  // The scene is as it was before the last change, and it drives again.
  takeBack() {
    const { drive, replay } = this;
    const world = this.past.pop();
    if (world === drive.original) this.undo();
    else {
      replay.world = drive.world = world;
      this.handle = null;
      this.restarted();
    }
    this.tell(world.own && AGAIN[this.tool] || HINTS[this.tool]);
    drive.race.tellScene();
  }

  // A change can be taken back; rows are never changed in place.
  kept(world = this.replay.world) {
    return world === this.drive.original ? world : Object.fromEntries(Object.entries(world).map(([field, value]) => [field, Array.isArray(value) && field !== "grid" ? [...value] : value]));
  }

  remove() {
    const { handle } = this;
    if (!handle || handle.kind !== "obstacle") return;
    this.past.push(this.kept());
    this.change((world) => {
      if (handle.index >= world.obstacles.length - (world.own || 0)) world.own -= 1;
      world.obstacles.splice(handle.index, 1);
      if (world.patrols.length) world.patrols.splice(handle.index, 1);
    });
    this.handle = null;
    this.restarted();
  }

  // What can be grabbed: things, and the knobs of the one that was grabbed last.
  handles() {
    const { world, step } = this.replay;
    const found = [];
    const turned = ([x, y, heading], kind) => found.push({ kind: "heading", of: kind, at: [x + 0.45 * Math.cos(heading), y + 0.45 * Math.sin(heading)], reach: 0.05, knob: true });
    if (world.goal) { found.push({ kind: "goal", at: world.goal, reach: 0.15 }); if (world.heading_tolerance < Math.PI) turned(world.goal, "goal"); }
    if (world.start) { found.push({ kind: "start", at: world.start, reach: 0.2 }); turned(world.start, "start"); }
    (world.waypoints || []).forEach((at, index) => found.push({ kind: "waypoint", index, at, reach: 0.15 }));
    const standing = obstaclesAt(world, step * DT);
    standing.forEach((at, index) => found.push({ kind: "obstacle", index, at, shape: at }));
    const chosen = this.handle && ["obstacle", "size", "turn", "end"].includes(this.handle.kind) ? standing[this.handle.index] : null;
    if (chosen) {
      const { index } = this.handle;
      const [x, y, c, s, l, w, r] = chosen;
      const knob = (kind, a, b, more = {}) => found.push({ kind, index, at: [x + a * c - b * s, y + a * s + b * c], reach: 0.02, knob: true, ...more });
      if (l === 0 && w === 0) knob("size", r, 0);
      else if (w === 0) { knob("end", l, 0, { sign: 1 }); knob("end", -l, 0, { sign: -1 }); } else { knob("size", l, w); knob("turn", l + 0.25, 0); }
    }
    (world.kind === "path" ? world.path : []).forEach((at, index) => found.push({ kind: "path", index, at, reach: 0.05 }));
    return found;
  }

  grab(point, reach) {
    const { replay } = this;
    if (this.tool === "move" || this.tool === "remove") {
      const slack = reach / replay.view.pixels;
      let best = null;
      for (const each of this.handles()) {
        if (this.tool === "remove" && each.kind !== "obstacle") continue;
        const distance = (each.shape ? distanceTo(each.shape, ...point) : Math.hypot(point[0] - each.at[0], point[1] - each.at[1]) - each.reach) - (each.knob ? Math.min(slack, 0.12) : 0);
        if (distance < slack && (!best || distance < best.distance)) best = { ...each, distance };
      }
      this.handle = best;
      if (this.tool === "remove") {
        if (!best || best.kind !== "obstacle") { this.tell("Nothing that can be deleted is there: click or tap an obstacle."); return false; }
        this.remove();
        this.tell("It is gone. Click or tap what else is to go.");
        return true;
      }
      if (!best) { replay.refresh(); return false; }
    }
    this.grabbed = point;
    this.line = [point];
    this.before = this.kept();
    this.played = replay.playing;
    replay.toggle(false);
    replay.refresh();
    return true;
  }

  // Nothing is led out of the picture.
  drag(point) {
    if (!this.grabbed) return false;
    const [x, y] = this.to = this.replay.view.within(point);
    if (this.tool === "path") {
      const [lx, ly] = this.line[this.line.length - 1];
      if (Math.hypot(x - lx, y - ly) > 3 / this.replay.view.pixels) this.line.push([x, y]);
    } else if (this.tool === "move") {
      this.moved(x, y);
      this.live();
    }
    this.replay.refresh();
    return true;
  }

  // The run that is looked at is driven again while one pulls, as often as there is time.
  live() {
    const now = performance.now();
    if (now - (this.drivenAt || 0) < 120) return;
    this.drivenAt = now;
    this.drive.changed();
  }

  moved(x, y) {
    const { handle, before } = this;
    const [dx, dy] = [x - this.grabbed[0], y - this.grabbed[1]];
    const { kind, index } = handle;
    this.change((world) => {
      if (kind === "goal" || kind === "start") world[kind] = [before[kind][0] + dx, before[kind][1] + dy, before[kind][2]];
      else if (kind === "heading") world[handle.of] = [before[handle.of][0], before[handle.of][1], Math.atan2(y - before[handle.of][1], x - before[handle.of][0])];
      else if (kind === "waypoint") world.waypoints[index] = [before.waypoints[index][0] + dx, before.waypoints[index][1] + dy];
      else if (kind === "path") {
        const [cx, cy] = before.path[index];
        // neighbours come along, the less the farther they are
        world.path = before.path.map(([px, py], k) => {
          const share = k === index ? 1 : Math.exp(-((px - cx) ** 2 + (py - cy) ** 2) / 0.5);
          return before.path.length < 40 && k !== index ? [px, py] : [px + share * dx, py + share * dy];
        });
      } else if (kind === "obstacle") {
        const [ox, oy, ...rest] = before.obstacles[index];
        world.obstacles[index] = [ox + dx, oy + dy, ...rest];
        if (before.patrols.length && before.patrols[index][4] > 0) {
          const [px, py, ...way] = before.patrols[index];
          world.patrols[index] = [px + dx, py + dy, ...way];
        }
      } else this.shaped(world, kind, index, x, y);
    });
  }

  shaped(world, kind, index, x, y) {
    const [ox, oy, c, s, l, w, r, mass] = this.before.obstacles[index];
    const [u, v] = [c * (x - ox) + s * (y - oy), c * (y - oy) - s * (x - ox)];
    if (kind === "size" && l === 0 && w === 0) world.obstacles[index] = [ox, oy, 1, 0, 0, 0, Math.max(Math.hypot(x - ox, y - oy), 0.05), mass];
    else if (kind === "size") world.obstacles[index] = [ox, oy, c, s, Math.max(Math.abs(u), 0.05), Math.max(Math.abs(v), 0.05), r, mass];
    else if (kind === "turn") {
      const length = Math.hypot(x - ox, y - oy) || 1;
      world.obstacles[index] = [ox, oy, (x - ox) / length, (y - oy) / length, l, w, r, mass];
    } else world.obstacles[index] = shapeOf.wall([ox - this.handle.sign * l * c, oy - this.handle.sign * l * s], [x, y]);
    if (kind === "end" && this.handle.sign < 0) { // the other end keeps its place
      const [nx, ny, nc, ns, ...rest] = world.obstacles[index];
      world.obstacles[index] = [nx, ny, -nc, -ns, ...rest];
    }
  }

  // A second finger came down: what one of them began to draw is nothing.
  letGo() {
    if (this.tool === "move") this.dropped();
    if (this.grabbed) this.replay.toggle(this.played);
    this.grabbed = this.to = null;
  }

  dropped() {
    if (!this.grabbed) return;
    const { tool, grabbed, to, played } = this;
    if (shapeOf[tool]) {
      const clicked = !to || Math.hypot(to[0] - grabbed[0], to[1] - grabbed[1]) * this.replay.view.pixels < 5;
      const [x, y] = grabbed;
      const half = tool === "disc" ? 0 : CLICKED;
      this.made = shapeOf[tool](clicked ? [x - half, y - half] : grabbed, clicked ? [x + half, y + half] : to);
    }
    this.grabbed = null;
    this.to = null;
    if (tool === "path") { this.follow(drawnPath(this.line)); return; }
    if (tool !== "move" && this.covers()) { this.replay.toggle(played); this.replay.refresh(); return; }
    if (tool !== "move" || to) this.past.push(this.before);
    if (tool !== "move") {
      this.change((world) => {
        world.obstacles.push(this.made);
        world.own = (world.own || 0) + 1;
        if (world.patrols.length) world.patrols.push([0, 0, 0, 0, 0, 0]);
        this.handle = { kind: "obstacle", index: world.obstacles.length - 1 };
      });
    }
    if (tool === "move" && !to) { this.replay.toggle(played); return; } // it was chosen, and stays where it is
    this.restarted();
    if (tool === "move") {
      this.say(this.covered());
      this.tell(HINTS.move);
      return;
    }
    this.ended();
  }

  // All start again, as is told.
  restarted() {
    this.drive.changed(true);
    this.replay.seek(0);
    this.replay.toggle(true);
  }

  // Told at once where a run could only wait for its time limit; what moves may go away.
  covered() {
    const { world, robot } = this.replay;
    if (world.kind === "dock") return ""; // it comes up to what stands there
    const standing = (world.obstacles || []).filter((_, k) => !((world.patrols || [])[k] || [])[4]);
    const place = standing.map((each) => standsOn(each, { ...world, walks: [] }, robot)).find(Boolean);
    return place ? `An obstacle stands ${place}: planners find no way there.` : "";
  }

  // Whether what was drawn stands where the robot starts or is to arrive; it is told.
  covers() {
    const { world, robot } = this.replay;
    const place = standsOn(this.made, world.path ? { ...world, waypoints: [] } : world, robot); // those along a line make room
    if (place) {
      this.replay.toggle(false);
      this.replay.seek(0); // where robots and people start is seen
      this.tell(`That would stand ${place}: put it elsewhere, or make it smaller.`);
    }
    return Boolean(place);
  }

  // What was drawn ends the tool, unless it stays for more.
  ended() {
    this.drive.race.tellScene();
    if (this.stays) this.tell(AGAIN[this.tool]);
    else this.take(null);
  }

  // A drawn line is a scenario of its own, and all that follow paths drive along it.
  follow(drawn) {
    if (!drawn) { this.tell("That line is shorter than 0.5 m: hold the button or the finger down, and draw a longer one."); this.replay.refresh(); return; }
    const { drive, replay } = this;
    const world = { kind: "path", name: "drawn", family: "", tier: "", quantity: null, steps: 2400, ...drawn, laps: 1, corridor: 1, start: null, start_offset: 0, start_turn: 0, edited: true };
    replay.blank = false;
    const { bounds, zoom, middle, least } = replay.view;
    const tall = replay.app.style.getPropertyValue("--tall");
    this.open(world, "A path that you drew; grey: the 1 m to either side within which a robot is still on it.");
    Object.assign(replay.view, { bounds, zoom, middle, least }); // the line stays where it was drawn
    replay.app.style.setProperty("--tall", tall);
    for (const point of world.path) replay.view.takeIn(point, 0.3);
    this.ended();
    drive.all();
  }

  // Shows a world, which is none of the page's own scenes unless it was one before it was edited.
  open(world, about, own = true) {
    const { drive, replay } = this;
    drive.clear();
    drive.world = drive.original = world;
    [this.handle, this.past] = [null, []];
    if (own) picks.own();
    replay.show(world, replay.robot, [], about);
  }

  // A map from an image; how large it is, its owner knows.
  map(pixels, name, side) {
    this.open(worldOfPixels(pixels, name, side), `${name}: a map from an image, ${short(side, 4)} m along its longer side; move start and goal as you like.`);
    const box = el("input", { type: "number", min: LEAST_SIDE, max: MOST_SIDE, step: "any", value: short(side, 4), "aria-label": "longer side of the map, m", on: { change: () => {
      const next = Number(box.value);
      if (!(next >= LEAST_SIDE && next <= MOST_SIDE)) { this.say(`The longer side is ${box.value || "empty"}; it must be from ${LEAST_SIDE} to ${MOST_SIDE} m.`); return; }
      try {
        this.map(pixels, name, next);
        this.say("");
        this.drive.go(false);
      } catch (error) {
        this.say(`${name} of ${next} m cannot be driven in: ${error.message}.`);
      }
    } } });
    const { hint } = this.replay;
    hint.hidden = false;
    hint.replaceChildren("How long is its longer side? ", box, " m", button("done", () => this.take(null)));
  }

  marks(context, pixel) {
    if (!this.tool) return;
    if (this.replay.blank && !this.grabbed) this.replay.view.write("draw here");
    context.strokeStyle = ink("--accent");
    context.lineWidth = 2 * pixel;
    if (this.cross) {
      const [x, y] = this.cross;
      context.beginPath();
      for (const [dx, dy] of [[12, 0], [0, 12]]) {
        context.moveTo(x - dx * pixel, y - dy * pixel);
        context.lineTo(x + dx * pixel, y + dy * pixel);
      }
      context.stroke();
    }
    if (this.grabbed && this.to && this.tool !== "move") {
      if (this.tool === "path") {
        context.beginPath();
        for (const point of this.line) context.lineTo(...point);
        context.stroke();
      } else drawObstacle(context, shapeOf[this.tool](this.grabbed, this.to), pixel);
    }
    if (this.tool !== "move") return;
    context.strokeStyle = ink("--accent");
    for (const each of this.handles()) {
      if (each.kind === "path" && each.index % Math.ceil((this.replay.world.path.length || 1) / 60)) continue;
      const chosen = this.handle && this.handle.kind === each.kind && this.handle.index === each.index;
      context.beginPath();
      if (each.knob) context.rect(each.at[0] - 5 * pixel, each.at[1] - 5 * pixel, 10 * pixel, 10 * pixel);
      else context.arc(each.at[0], each.at[1], (chosen ? 9 : 5) * pixel, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  save() {
    if (this.replay.world.walks) { this.say("No file holds several bodies yet: copy a link, or Python."); return; }
    downloaded(new Blob([fileOf(this.replay.world)], { type: "application/json" }), `${(this.replay.world.name || "scenario").replace(/[^\w.-]/g, "_")}.json`);
  }

  // A scenario, a robot's data sheet, or the image of a map, with the file that tells its scale if there is one.
  async load(files) {
    const scale = files.find(({ name }) => /\.ya?ml$/i.test(name));
    const file = files.find((each) => each !== scale) || scale;
    if (!file) return;
    try {
      if (file === scale) throw new Error("it only tells the scale of a map: give the image (PNG or JPEG) with it");
      if (file.size > 20e6) throw new Error(`it has ${file.size} bytes; a scenario has at most 20 million`);
      const name = file.name.replace(/\.\w+$/, "");
      const image = file.type.startsWith("image/");
      const text = image ? "" : await file.text();
      if (/"(wheels|hull)"\s*:/.test(text)) { this.drive.adopt(parsed(text)); this.file.value = ""; return; }
      if (image) {
        const pixels = await pixelsOf(file);
        this.map(pixels, name, scale ? sideOf(await scale.text(), pixels.longest) : IMAGE_SIDE);
      }
      else {
        const world = worldOf(text, name);
        for (const [k, shape] of (world.obstacles || []).entries()) {
          const place = standsOn(shape, world, this.replay.robot);
          if (place) throw new Error(`obstacles[${k}] stands ${place}`);
        }
        this.open(world, `${name}: a scenario of your own.`);
      }
      this.say("");
      this.drive.go(false);
    } catch (error) {
      this.say(`${file.name} cannot be driven in: ${error.message}.`);
    }
    this.file.value = "";
  }
}
