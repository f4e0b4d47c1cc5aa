// Without a run: scenarios of every family, drawn by their seed.

class Draws {
  constructor(replay) {
    this.replay = replay;
    this.families = new Map();
    replay.told.worlds.forEach((world) => {
      const key = `${world.kind === "path" ? "path" : "goal"}: ${world.family}`;
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
    const world = this.families.get(this.family.value)[Number(this.seed.value)];
    if (drive) drive.stop();
    this.replay.show(world, drive ? drive.robot.value : "p3dx", [], `${world.family}, seed ${world.seed}: a scenario of the training split.`);
    if (drive) drive.go();
  }

  open() {}
}
