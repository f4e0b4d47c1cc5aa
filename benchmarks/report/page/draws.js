// Without a run: scenarios of every family, drawn by their seed.

// A world for a hull of that radius (m): what the robot docks at is moved up to a smaller one, as Python does.
function fitted(world, hull) {
  const made = world.made || world;
  if (!made.closing) return world;
  const shrinkage = made.hull - hull;
  const obstacles = made.obstacles.map(([x, y, ...shape], k) => [x + shrinkage * made.closing[k][0], y + shrinkage * made.closing[k][1], ...shape]);
  return { ...made, obstacles, made };
}

class Draws {
  constructor(replay) {
    this.replay = replay;
    this.families = new Map();
    replay.told.worlds.forEach((world) => {
      const key = `${world.kind}: ${world.family}`;
      (this.families.get(key) || this.families.set(key, []).get(key)).push(world);
    });
    const select = (label, change) => {
      const box = el("select", { on: { change } });
      replay.picks.append(el("label", {}, label, box));
      return box;
    };
    this.family = select("family", () => this.fill());
    this.seed = select("seed", () => this.show());
    this.family.replaceChildren(...[...this.families.keys()].map((key) => el("option", { value: key }, key)));
    this.family.value = replay.told.demo.first;
    this.fill();
  }

  fill() {
    const worlds = this.families.get(this.family.value);
    this.seed.replaceChildren(...worlds.map((world, k) => el("option", { value: k }, `${world.seed}${world.tier ? `, ${world.tier}` : ""}`)));
    this.show();
  }

  show() {
    const robot = drive ? drive.robot.value : "p3dx";
    const world = fitted(this.families.get(this.family.value)[Number(this.seed.value)], HULLS[robot]);
    if (drive) drive.stop();
    this.replay.show(world, robot, [], `${world.family}, seed ${world.seed}: a scenario of the training split.`);
    if (drive) drive.go();
  }

  open() {}
}
