// Without a run: scenarios of every family, drawn by their seed.

// A world for a hull of that radius (m): what the robot docks at is moved up to a smaller one, as Python does.
function fitted(world, hull) {
  const made = world.made || world;
  if (!made.closing) return world;
  const shrinkage = made.hull - hull;
  const obstacles = made.obstacles.map(([x, y, ...shape], k) => [x + shrinkage * made.closing[k][0], y + shrinkage * made.closing[k][1], ...shape]);
  return { ...made, obstacles, made };
}

const ABOUT_BODIES = { team: "The policy drives all robots; the chosen run shows the others.", people: "People are grey; the chosen run shows them." };

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
    this.seed = select("number", () => this.show());
    this.family.replaceChildren(...[...this.families.keys()].map((key) => el("option", { value: key }, key)));
    this.family.value = replay.told.demo.opening.place.family;
    this.fill();
  }

  fill() {
    const worlds = this.families.get(this.family.value);
    this.seed.replaceChildren(...worlds.map((world, k) => el("option", { value: k }, `no. ${world.seed}${world.tier ? `, ${world.tier} difficulty` : ""}`)));
    this.show();
  }

  show() {
    if (drive && !this.silent) drive.robot.value = drive.robotFor(this.families.get(this.family.value)[0]);
    const robot = drive ? drive.robot.value : "p3dx";
    const world = fitted(this.families.get(this.family.value)[Number(this.seed.value)], HULLS[robot]);
    if (drive) drive.clear();
    this.replay.show(world, robot, [], `${world.family}, no. ${world.seed}: a scene of the test split, which no agent was trained in.${world.walks ? ` ${ABOUT_BODIES[world.kind]}` : ""}`);
    if (!drive || this.silent) return;
    if (drive.who.value === KEYBOARD) drive.who.value = drive.usual(drive.able()) || KEYBOARD;
    drive.go(false);
  }

  // Which scenario is shown, and back.
  state() {
    return { family: this.family.value, seed: Number(this.seed.value) };
  }

  restore({ family, seed }) {
    if (!this.families.has(family)) throw new Error(`family is ${JSON.stringify(family)}; it must be one of ${[...this.families.keys()].join(", ")}`);
    const count = this.families.get(family).length;
    if (!Number.isInteger(seed) || seed < 0 || seed >= count) throw new Error(`seed is ${JSON.stringify(seed)}; it must be from 0 to ${count - 1}`);
    this.silent = true;
    this.family.value = family;
    this.fill();
    this.seed.value = String(seed);
    this.show();
    this.silent = false;
  }

  open() {}
}
