// Without a run: scenarios of every family, drawn by their seed.

// A world for a hull of that radius (m), as Python has it: what the robot docks at is moved up to a smaller one, or away from
// a larger one; of what a larger one drives to, all places and sizes grow with its class. What was edited stays as it is.
function fitted(world, hull) {
  const made = world.made || world;
  if (world.edited || !made.obstacles || !made.hull) return world;
  const size = hull > made.hull ? Number((0.05 * Math.ceil((hull / 0.05).toFixed(9))).toFixed(2)) : hull;
  if (made.closing) {
    const obstacles = made.obstacles.map(([x, y, ...shape], k) => [x + (made.hull - size) * made.closing[k][0], y + (made.hull - size) * made.closing[k][1], ...shape]);
    return { ...made, obstacles, made };
  }
  if (made.kind !== "goal" || size <= made.hull) return made;
  const factor = size / made.hull;
  const pose = ([x, y, heading]) => [factor * x, factor * y, heading];
  return { ...made, start: pose(made.start), goal: pose(made.goal), made,
    obstacles: made.obstacles.map(([x, y, c, s, l, w, r, mass]) => [factor * x, factor * y, c, s, factor * l, factor * w, factor * r, mass]),
    patrols: made.patrols.map(([x, y, vx, vy, time, phase]) => [factor * x, factor * y, vx, vy, factor * time, factor * phase]) };
}

const ABOUT_BODIES = { team: "One driver for all robots, each with a star of its own; a robot that arrives is taken out.", people: "The grey discs are people: they walk, and react to the robot." };
const SCENES = { goal: "drive to a star", people: "among people", team: "a team of robots", path: "along a path", dock: "docking" };

class Draws {
  constructor(replay) {
    this.replay = replay;
    this.families = new Map();
    replay.told.worlds.forEach((world) => {
      const key = `${world.kind}: ${world.family}`;
      (this.families.get(key) || this.families.set(key, []).get(key)).push(world);
    });
    const select = (label, change) => {
      const box = el("select", { "aria-label": label, on: { change } });
      replay.picks.append(el("label", {}, label, box));
      return box;
    };
    this.family = select("scene", () => this.fill());
    this.seed = select("layout", () => this.show());
    const keys = [...this.families.keys()];
    this.family.replaceChildren(el("option", { value: "", hidden: true }, "your own"), ...Object.entries(SCENES).map(([kind, text]) => el("optgroup", { label: text },
      keys.filter((key) => key.startsWith(`${kind}: `)).map((key) => el("option", { value: key }, replay.told.demo.scenes[key])))));
    this.family.value = replay.told.demo.opening.place.family;
    this.fill();
  }

  fill() {
    const worlds = this.families.get(this.family.value);
    this.seed.replaceChildren(...worlds.map((world, k) => el("option", { value: k }, `${world.seed + 1} of ${worlds.length}${world.tier ? ` (${world.tier})` : ""}`)));
    this.show();
  }

  show() {
    if (drive && !this.silent) drive.robot.value = drive.robotFor(this.families.get(this.family.value)[0]);
    const robot = drive ? drive.robot.value : "p3dx";
    const world = fitted(this.families.get(this.family.value)[Number(this.seed.value)], HULLS[robot]);
    this.seed.parentElement.hidden = false;
    const change = () => {
      if (drive) drive.editor.take(null);
      this.replay.show(world, robot, [], `${world.walks ? `${ABOUT_BODIES[world.kind]} ` : ""}${(world.patrols || []).some(([, , , , time]) => time > 0) ? "Grey discs are obstacles; those with a dashed line move along it. " : ""}`);
    };
    if (drive && !this.silent) { drive.anew(THERE, change); return; }
    if (drive) drive.clear();
    change();
  }

  // A scene that is none of these: drawn, or from a file.
  own() {
    this.family.value = "";
    this.seed.parentElement.hidden = true;
  }

  // Which scenario is shown, if it is one of these, and back.
  state() {
    return this.family.value ? { family: this.family.value, seed: Number(this.seed.value) } : null;
  }

  // Whether there is such a scene; an Error says what is wrong.
  check(place) {
    onlyFields(place, ["family", "seed"], "place: ");
    const { family, seed } = place;
    if (!this.families.has(family)) throw new Error(`family is ${quoted(family)}; the page has no such scene`);
    const count = this.families.get(family).length;
    if (!Number.isInteger(seed) || seed < 0 || seed >= count) throw new Error(`seed is ${quoted(seed)}; it must be from 0 to ${count - 1}`);
  }

  restore({ family, seed }) {
    this.check({ family, seed });
    this.silent = true;
    this.family.value = family;
    this.fill();
    this.seed.value = String(seed);
    this.show();
    this.silent = false;
  }

  open() {}
}
