// Which episodes are shown: those of one scenario under one set of conditions.

class Picks {
  constructor(replay) {
    this.replay = replay;
    this.episodes = replay.told.episodes;
    this.groups = new Map();
    for (const episode of this.episodes) {
      const task = [episode.contest, episode.robot, episode.plant, episode.actuators, episode.disturbance === "none" ? "" : episode.disturbance].filter(Boolean).join(" · ");
      const families = this.groups.get(task) || this.groups.set(task, new Map()).get(task);
      const worlds = families.get(episode.family) || families.set(episode.family, new Map()).get(episode.family);
      (worlds.get(episode.world) || worlds.set(episode.world, []).get(episode.world)).push(episode);
    }
    const select = (label, change) => {
      const box = el("select", { on: { change } });
      replay.picks.append(el("label", {}, label, box));
      return box;
    };
    this.task = select("task", () => this.fillFamilies());
    this.family = select("family", () => this.fillWorlds());
    this.world = select("scenario", () => this.show());
    this.options(this.task, [...this.groups.keys()].map((task) => [task, task]));
    this.fillFamilies();
  }

  options(box, pairs) {
    box.replaceChildren(...pairs.map(([value, text]) => el("option", { value }, text)));
  }

  fillFamilies(wanted) {
    const families = this.groups.get(this.task.value);
    this.options(this.family, [...families.keys()].map((family) => [family, family]));
    if (wanted !== undefined) this.family.value = wanted;
    this.fillWorlds();
  }

  fillWorlds(wanted) {
    const worlds = this.groups.get(this.task.value).get(this.family.value);
    this.options(this.world, [...worlds.entries()].map(([world, episodes], k) => {
      const failed = new Set(episodes.filter((each) => each.outcome !== "success").map((each) => each.policy)).size;
      return [world, `${k + 1}${episodes[0].tier ? `, ${episodes[0].tier}` : ""}${failed ? `, ${failed} fail` : ""}`];
    }));
    if (wanted !== undefined) this.world.value = String(wanted);
    this.show();
  }

  show(policy) {
    const { replay } = this;
    const episodes = this.groups.get(this.task.value).get(this.family.value).get(Number(this.world.value));
    const kept = episodes.filter((each) => each.drive !== undefined);
    const world = replay.told.worlds[Number(this.world.value)];
    // a robot that does not ship tells its hull with its episodes
    if (episodes[0].hull !== undefined) tellHull(episodes[0].robot, episodes[0].hull);
    const many = new Map();
    for (const each of kept) many.set(each.policy, (many.get(each.policy) || 0) + 1);
    const seen = new Map();
    const actors = kept.map((each) => {
      const drive = unpacked(replay.packed, replay.told.drives[each.drive]);
      const nth = (seen.get(each.policy) || 0) + 1;
      seen.set(each.policy, nth);
      const label = each.agent !== "" ? `${each.policy}, seed ${each.agent}` : many.get(each.policy) > 1 ? `${each.policy}, run ${nth}` : each.policy;
      const cost = each.error !== undefined ? `typically ${millimetres(each.error)} mm off, ` : "";
      return { ...drive, policy: each.policy, label, outcome: each.outcome, note: `${cost}${each.time.toFixed(2)} s`, robot: each.robot, told: each,
        hidden: each.agent !== "" && nth > 1 };
    });
    const left = episodes.length - kept.length;
    const about = [`${episodes[0].family}${world.tier ? `, ${world.tier}` : ""}: ${kept.length} of ${episodes.length} episodes can be replayed.`];
    if (left) about.push("The others did not fit into the file; their numbers are in the tables.");
    if (world.obstacles && world.obstacles.some((each) => each[7] > 0)) about.push("Boxes that can be pushed (dashed) are drawn where they stood at the start.");
    if (world.bodies) about.push(kept.length && !actors[0].others.length ? "Of more than 64 bodies only the first robot is drawn." : "The other bodies are those of the chosen run; people are grey.");
    if (world.speed) about.push(`The target speed is ${short(world.speed)} m/s.`);
    about.push("Poses are rounded to 1 mm and 1 mrad.");
    replay.show(world, episodes[0].robot, actors, about.join(" "));
    const wanted = actors.find((actor) => actor.policy === policy);
    if (wanted) replay.choose(wanted);
  }

  own() {}

  state() {
    return { task: this.task.value, family: this.family.value, world: Number(this.world.value) };
  }

  check({ task, family, world }) {
    const families = this.groups.get(task);
    if (!families || !families.has(family) || !families.get(family).has(world)) throw new Error("its scenario is not in this report");
  }

  restore({ task, family, world }) {
    this.check({ task, family, world });
    this.task.value = task;
    this.fillFamilies(family);
    this.fillWorlds(world);
  }

  // The leader of the first contest and the next play side by side, in a scenario that both complete if one is in the file.
  duel(duels) {
    for (const { contest, robot, policies } of duels) {
      const of = (policy) => this.episodes.filter((each) => each.contest === contest && robot.startsWith(each.robot) && each.policy === policy && each.drive !== undefined);
      const [first, ...others] = policies.map(of);
      const beside = (each) => others.every((mine) => mine.some((other) => other.world === each.world && other.outcome === "success"));
      const found = first.filter((each) => each.outcome === "success" && beside(each)).pop() || first[0]; // later families are harder
      if (!found) continue;
      this.goTo(found, policies[0]);
      this.replay.split(this.replay.actors.find((actor) => actor.policy === policies[1] && !actor.hidden));
      if (!still()) this.replay.toggle(true);
      return;
    }
  }

  goTo(episode, policy) {
    for (const [task, families] of this.groups) {
      const worlds = families.get(episode.family);
      if (worlds && worlds.has(episode.world) && worlds.get(episode.world).includes(episode)) this.task.value = task;
    }
    this.fillFamilies(episode.family);
    this.fillWorlds(episode.world);
    this.show(policy);
  }

  // A cell of the heat map: the first scenario of its family or tier, the worst of that policy first.
  open({ contest, robot, kind, name, policy }) {
    const fits = this.episodes.filter((each) => each.contest === contest && robot.startsWith(each.robot) && each[kind] === name && each.policy === policy);
    const found = fits.find((each) => each.outcome !== "success" && each.drive !== undefined) || fits.find((each) => each.drive !== undefined) || fits[0];
    if (!found) return say("none of these episodes is in the file");
    this.goTo(found, policy);
    showTab("replay");
    this.replay.canvas.focus({ preventScroll: true });
    return undefined;
  }
}
