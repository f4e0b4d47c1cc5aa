// Take over: another policy, the keyboard, or another world drive on from any moment.

const KEYBOARD = "you, by the keyboard";
const FAST = 8; // ms of a frame for the simulator
const AHEAD = 3000; // ms to catch up after a change of the world

// Whether the cells of a world's map are not in the page.
const outlined = (world) => Boolean(world.walls && !world.grid);

class Drive {
  constructor(replay, kernels, free) {
    this.replay = replay;
    this.kernels = kernels;
    this.run = null;
    this.edits = false;
    this.held = new Set();
    this.handle = null;
    const select = (label, options, change = () => {}) => {
      const box = el("select", { on: { change } }, options.map((each) => el("option", { value: each }, each)));
      return [box, el("label", {}, label, box)];
    };
    const [who, whoLabel] = select("who drives", []);
    const [from, fromLabel] = select("from", ["the start", "this moment of the chosen robot"]);
    const [robot, robotLabel] = select("robot", robotsOf(kernels), () => this.embody());
    const [tier, tierLabel] = select("actuators", kernels.tables.tiers, () => this.offer());
    const [disturbance, disturbanceLabel] = select("disturbance", Object.keys(kernels.tables.disturbances));
    Object.assign(this, { who, from, robot, tier, disturbance });
    tier.value = "lagged";
    const button = (text, click) => el("button", { type: "button", on: { click } }, text);
    this.editButton = el("button", { type: "button", "aria-pressed": "false", on: { click: () => this.edit(!this.edits) } }, "move things");
    this.goButton = button("drive", () => this.go());
    this.cannot = el("p", { class: "note" });
    this.result = el("p", { class: "note", role: "status" });
    this.file = el("input", { type: "file", accept: ".json,application/json", class: "hidden", tabindex: "-1", "aria-label": "scenario file", on: { change: () => this.load(this.file.files[0]) } });
    this.tools = el("span", { class: "files", hidden: true }, button("+ circle", () => this.put([0, 0, 1, 0, 0, 0, 0.4, 0])),
      button("+ box", () => this.put([0, 0, 1, 0, 0.6, 0.3, 0, 0])), button("+ wall", () => this.put([0, 0, 0, 1, 1, 0, 0, 0])),
      button("remove", () => this.remove()), button("undo all", () => this.undo()));
    this.pad = el("div", { class: "pad", hidden: true, "aria-label": "drive by hand" });
    for (const [text, key] of [["↶", "q"], ["↑", "ArrowUp"], ["↷", "e"], ["←", "ArrowLeft"], ["↓", "ArrowDown"], ["→", "ArrowRight"]]) {
      this.pad.append(el("button", { type: "button", "aria-label": `drive ${key}`, on: {
        pointerdown: () => this.held.add(key), pointerup: () => this.held.delete(key), pointerleave: () => this.held.delete(key) } }, text));
    }
    this.panel = el("div", { class: "drive" }, el("h3", {}, "Drive it yourself, or let another drive"),
      el("div", { class: "pick" }, whoLabel, fromLabel, free ? robotLabel : null, tierLabel, disturbanceLabel),
      el("div", { class: "files" }, this.goButton, this.editButton, this.tools, button("save scenario", () => this.save()), button("load scenario", () => this.file.click()), this.file),
      this.pad, this.result,
      el("p", { class: "note" }, "The page runs the package's own compiled code: without disturbance, runs of the frozen scenarios are those of Python to the last bit. ",
        "Disturbed runs draw the page's own noise. By keyboard: arrows drive and turn; an omni base also moves sideways with A and D and turns with Q and E. ",
        "A scenario file can be dropped on the picture."), this.cannot);
    replay.below.append(this.panel);
    replay.listeners.push(() => this.offer());
    this.wire();
    this.offer();
  }

  wire() {
    const { replay } = this;
    replay.advance = (due) => this.advance(due);
    replay.driven = (event, down) => this.key(event, down);
    replay.grab = (event) => this.grab(event);
    replay.drag = (event) => this.drag(event);
    replay.drop = () => this.dropped();
    replay.overlay = (context, pixel) => this.marks(context, pixel);
    replay.canvas.addEventListener("keyup", (event) => this.key(event, false));
    replay.canvas.addEventListener("blur", () => this.held.clear());
    replay.board.addEventListener("dragover", (event) => { event.preventDefault(); replay.board.classList.add("drop"); });
    replay.board.addEventListener("dragleave", () => replay.board.classList.remove("drop"));
    replay.board.addEventListener("drop", (event) => { event.preventDefault(); replay.board.classList.remove("drop"); this.load(event.dataTransfer.files[0]); });
  }

  get task() {
    return taskOf(this.kernels, this.replay.world);
  }

  // Who can drive here, and who cannot and why.
  offer() {
    const { replay, kernels, who } = this;
    if (replay.world !== this.world && this.run && !replay.actors.includes(this.run.actor)) this.stop();
    if (replay.world !== this.world && !this.changing) { this.world = replay.world; this.original = replay.world; this.edit(this.edits); }
    this.robot.value = replay.robot;
    const told = replay.chosen && replay.chosen.told;
    if (told && told !== this.toldOf) { this.toldOf = told; this.tier.value = told.actuators; }
    const able = pilotsOf(kernels, this.task, replay.robot, this.tier.value);
    const before = who.value;
    who.replaceChildren(...[KEYBOARD, ...able].map((each) => el("option", { value: each }, each)));
    who.value = able.includes(before) || before === KEYBOARD ? before : able.find((each) => each.startsWith("ppo")) || able[0] || KEYBOARD;
    const others = replay.told.demo ? (replay.told.demo.unable || {})[replay.world.kind] || [] : [];
    const unable = [...new Set([...replay.actors.filter((actor) => actor.told && !able.includes(actor.policy)).map((actor) => actor.policy), ...others])];
    const reason = (label) => (label.startsWith("mpc") ? "solves its problem with OSQP" : label.startsWith("ppo") ? "" : label.startsWith("hybrid") ? "joins two that drive here" : label.startsWith("nav2") ? "keeps a cost map that the page does not carry" : "decides in NumPy");
    this.cannot.textContent = unable.length ? `Cannot drive in the page: ${unable.map((each) => `${each}${reason(each) ? ` (${reason(each)})` : ""}`).join(", ")}.` : "";
    if (!this.task) this.cannot.textContent = "Such scenarios are replayed; nobody can drive in them in the page.";
    if (outlined(replay.world)) this.cannot.textContent += " The map is too large for the page: here one drives among the walls of its outline, and runs are near those of Python, not the same to the last bit.";
    this.goButton.disabled = !this.kernels || !this.task;
  }

  // Another robot drives: what a hull docks at comes up to it.
  embody() {
    const { replay } = this;
    const world = fitted(replay.world, HULLS[this.robot.value]);
    replay.robot = this.robot.value;
    if (world === replay.world) { this.offer(); return; }
    this.stop();
    replay.show(world, replay.robot, [], replay.told_of.textContent);
  }

  conditions() {
    return { robot: this.replay.robot, actuators: this.tier.value, disturbance: this.disturbance.value, seed: 1 };
  }

  go() {
    const { replay } = this;
    const chosen = this.from.value === "the start" ? null : replay.chosen;
    if (this.who.value === KEYBOARD && !chosen) this.rival();
    this.start({ label: this.who.value, from: chosen, step: chosen ? Math.min(replay.step, chosen.x.length - 1) : 0, conditions: this.conditions() });
    replay.canvas.focus({ preventScroll: true });
    replay.toggle(true);
  }

  // Who drives by hand has the trained agent to race, where one is there and nobody else drives.
  rival() {
    const { replay, kernels } = this;
    const conditions = this.conditions();
    const label = pilotsOf(kernels, this.task, conditions.robot, conditions.actuators).find((each) => each.startsWith("ppo"));
    if (!label || replay.actors.some((actor) => !actor.ghost && actor.policy !== KEYBOARD)) return;
    this.start({ label, from: null, step: 0, conditions });
    this.advance(replay.world.steps || 2400, AHEAD);
  }

  // Begins a run: from the start, from a moment that is driven again to the last bit, or from a rounded pose.
  start(asked, again = false) {
    const { replay, kernels } = this;
    this.stop(!again && this.run !== null && this.run.asked.label !== asked.label && this.run.actor.x.length > 10);
    const { label, from, step, conditions } = asked;
    let simulator = null;
    let pilot = null;
    try {
      simulator = new Simulator(kernels, replay.world, conditions);
      const exact = this.again(simulator, asked);
      const actor = { x: [], y: [], heading: [], policy: label, label, outcome: "", note: exact, robot: conditions.robot, error: replay.world.kind === "path" ? [] : null };
      if (from) for (let k = 0; k < step; k++) this.note(actor, [from.x[k], from.y[k], from.heading[k]], from.error ? from.error[k] : 0);
      this.note(actor, simulator.pose, this.errorOf(simulator));
      pilot = label === KEYBOARD ? null : pilotFor(simulator, label);
      this.run = { asked, simulator, pilot, actor };
      replay.live = actor;
      this.pad.hidden = label !== KEYBOARD;
      replay.add(actor);
      replay.seek(from ? step : 0);
      this.result.textContent = "";
    } catch (error) {
      this.result.textContent = `This cannot be driven: ${error.message}`;
      if (simulator) simulator.free();
    }
  }

  again(simulator, { from, step, conditions }) {
    if (!from || !step) {
      simulator.reset();
      return from ? "" : "in the page";
    }
    const told = from.told;
    const same = told && !outlined(this.replay.world) && this.replay.world === this.original && told.plant === "kinematic" && told.actuators === conditions.actuators && told.disturbance === "none" && conditions.disturbance === "none";
    simulator.reset();
    const before = same ? pilotFor(simulator, from.policy) : null;
    if (before && (!from.told.agent || from.told.agent === "0")) {
      for (let k = 0; k < step; k++) simulator.step(before.act());
      return `from ${(step * DT).toFixed(2)} s of ${from.label}`;
    }
    const [a, b] = [Math.max(step - 2, 0), Math.min(step + 2, from.x.length - 1)];
    const heading = from.heading[step];
    const [vx, vy] = [(from.x[b] - from.x[a]) / ((b - a) * DT), (from.y[b] - from.y[a]) / ((b - a) * DT)];
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const turn = (from.heading[b] - from.heading[a]) / ((b - a) * DT);
    const wrapped = Math.atan2(Math.sin(heading), Math.cos(heading));
    simulator.takeUp([from.x[step], from.y[step], wrapped], [c * vx + s * vy, simulator.body.axes.length > 2 ? c * vy - s * vx : 0, turn], from, step);
    return `from the rounded pose at ${(step * DT).toFixed(2)} s of ${from.label}`;
  }

  note(actor, [x, y, heading], error) {
    const last = actor.heading.length ? actor.heading[actor.heading.length - 1] : heading;
    actor.x.push(x);
    actor.y.push(y);
    actor.heading.push(last + Math.atan2(Math.sin(heading - last), Math.cos(heading - last)));
    if (actor.error) actor.error.push(error);
  }

  errorOf(simulator) {
    return simulator.world.kind === "path" ? simulator.state.get("cross_track_error") : 0;
  }

  // Ends the run; what it drove so far may stay, beside the next.
  stop(keep = false) {
    if (!this.run) return;
    this.run.simulator.free();
    if (!keep) this.replay.actors = this.replay.actors.filter((actor) => actor !== this.run.actor);
    else if (!this.run.actor.outcome) this.run.actor.note += ", stopped";
    this.replay.live = null;
    this.run = null;
  }

  // Steps the run until it has come to a moment, or the frame's time is spent.
  advance(due, budget = FAST) {
    const { run, replay } = this;
    if (!run || run.actor.outcome) return;
    const { simulator, pilot, actor } = run;
    const begun = performance.now();
    while (actor.x.length - 1 < due && performance.now() - begun < budget) {
      const flags = simulator.step(pilot ? pilot.act() : this.hand(simulator));
      this.note(actor, simulator.pose, this.errorOf(simulator));
      if (flags.ended || actor.x.length > (replay.world.steps || 2400)) {
        actor.outcome = flags.success ? "success" : flags.collision ? "collision" : flags.left_corridor ? "left_corridor" : "timeout";
        actor.note += `, ${((actor.x.length - 1) * DT).toFixed(2)} s`;
        replay.live = null;
        this.result.textContent = `${actor.label}: ${OUTCOMES[actor.outcome]} after ${((actor.x.length - 1) * DT).toFixed(2)} s.`;
        replay.listActors();
        break;
      }
    }
    replay.stretch();
  }

  hand(simulator) {
    const [fast, turn] = [0.6, 1.5];
    const on = (...keys) => (keys.some((key) => this.held.has(key)) ? 1 : 0);
    const omni = simulator.body.axes.length > 2;
    return [fast * (on("ArrowUp", "w") - on("ArrowDown", "s")), omni ? fast * (on("a") - on("d")) : 0,
      turn * (on("ArrowLeft", "q") - on("ArrowRight", "e"))];
  }

  key(event, down) {
    if (!this.run || this.run.pilot || this.run.actor.outcome) return false;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "w", "a", "s", "d", "q", "e"].includes(key)) return false;
    event.preventDefault();
    if (down) this.held.add(key);
    else this.held.delete(key);
    if (down) this.replay.toggle(true);
    return true;
  }

  // The same run once more, in a world that has changed, up to the moment that is shown.
  rerun() {
    const { replay, run } = this;
    if (!run || !run.pilot) return;
    const { step } = replay;
    this.start(run.asked, true);
    this.advance(step, AHEAD);
    replay.seek(step);
  }

  edit(on) {
    this.edits = on;
    this.editButton.setAttribute("aria-pressed", on);
    this.tools.hidden = !on;
    this.replay.refresh();
  }

  change(apply) {
    const { replay } = this;
    if (replay.world === this.original) {
      replay.world = structuredClone(this.original);
      delete replay.world.made; // what was moved by hand stays there for every hull
      delete replay.world.closing;
      for (const actor of replay.actors) if (actor.told) actor.ghost = true;
    }
    apply(replay.world);
    this.world = replay.world;
  }

  undo() {
    this.replay.world = this.world = this.original;
    for (const actor of this.replay.actors) actor.ghost = false;
    this.handle = null;
    this.rerun();
    this.replay.refresh(true);
  }

  put(shape) {
    if (this.replay.world.path) { this.result.textContent = "Nothing stands beside a path; its points can be moved."; return; }
    const [x, y] = this.replay.view.centre;
    this.change((world) => {
      world.obstacles.push([x, y, ...shape.slice(2)]);
      if (world.patrols.length) world.patrols.push([0, 0, 0, 0, 0, 0]);
      this.handle = { kind: "obstacle", index: world.obstacles.length - 1 };
    });
    this.changed();
  }

  remove() {
    const { handle } = this;
    if (!handle || handle.kind !== "obstacle") { this.result.textContent = "Choose an obstacle first: click on it."; return; }
    this.change((world) => {
      world.obstacles.splice(handle.index, 1);
      if (world.patrols.length) world.patrols.splice(handle.index, 1);
    });
    this.handle = null;
    this.changed();
  }

  changed() {
    this.rerun();
    this.replay.refresh(true);
  }

  handles() {
    const { world, step } = this.replay;
    const found = [];
    if (world.goal) found.push({ kind: "goal", at: world.goal, reach: 0.15 });
    if (world.start) found.push({ kind: "start", at: world.start, reach: 0.2 });
    (world.waypoints || []).forEach((at, index) => found.push({ kind: "waypoint", index, at, reach: 0.15 }));
    obstaclesAt(world, step * DT).forEach((at, index) => found.push({ kind: "obstacle", index, at, shape: at }));
    (world.path || []).forEach((at, index) => found.push({ kind: "path", index, at, reach: 0.05 }));
    return found;
  }

  grab(event) {
    if (!this.edits) return false;
    const { replay } = this;
    const [x, y] = replay.view.metres(event);
    const slack = 10 / replay.view.pixels;
    let best = null;
    for (const each of this.handles()) {
      const distance = each.shape ? distanceTo(each.shape, x, y) : Math.hypot(x - each.at[0], y - each.at[1]) - each.reach;
      if (distance < slack && (!best || distance < best.distance)) best = { ...each, distance };
    }
    this.handle = best;
    if (!best) return false;
    this.grabbed = [x, y];
    this.before = structuredClone(replay.world);
    replay.toggle(false);
    replay.canvas.setPointerCapture(event.pointerId);
    return true;
  }

  drag(event) {
    if (!this.grabbed || !this.handle) return false;
    const { handle, before } = this;
    const [x, y] = this.replay.view.metres(event);
    const [dx, dy] = [x - this.grabbed[0], y - this.grabbed[1]];
    this.change((world) => {
      if (handle.kind === "goal" || handle.kind === "start") world[handle.kind] = [before[handle.kind][0] + dx, before[handle.kind][1] + dy, before[handle.kind][2]];
      else if (handle.kind === "waypoint") world.waypoints[handle.index] = [before.waypoints[handle.index][0] + dx, before.waypoints[handle.index][1] + dy];
      else if (handle.kind === "obstacle") {
        const [ox, oy, ...rest] = before.obstacles[handle.index];
        world.obstacles[handle.index] = [ox + dx, oy + dy, ...rest];
        if (before.patrols.length && before.patrols[handle.index][4] > 0) {
          const [px, py, ...way] = before.patrols[handle.index];
          world.patrols[handle.index] = [px + dx, py + dy, ...way];
        }
      } else {
        const [cx, cy] = before.path[handle.index];
        // neighbours come along, the less the farther they are
        world.path = before.path.map(([px, py], k) => {
          const share = k === handle.index ? 1 : Math.exp(-((px - cx) ** 2 + (py - cy) ** 2) / 0.5);
          return before.path.length < 40 && k !== handle.index ? [px, py] : [px + share * dx, py + share * dy];
        });
      }
    });
    this.replay.refresh();
    return true;
  }

  dropped() {
    if (!this.grabbed) return;
    this.grabbed = null;
    if (this.replay.world !== this.original) this.changed();
  }

  marks(context, pixel) {
    if (!this.edits) return;
    context.strokeStyle = ink("--accent");
    context.lineWidth = 2 * pixel;
    for (const each of this.handles()) {
      if (each.kind === "path" && each.index % Math.ceil((this.replay.world.path.length || 1) / 60)) continue;
      const chosen = this.handle && this.handle.kind === each.kind && this.handle.index === each.index;
      context.beginPath();
      context.arc(each.at[0], each.at[1], (chosen ? 9 : 5) * pixel, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  save() {
    const blob = new Blob([fileOf(this.replay.world)], { type: "application/json" });
    const link = el("a", { href: URL.createObjectURL(blob), download: `${(this.replay.world.name || "scenario").replace(/[^\w.-]/g, "_")}.json` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  async load(file) {
    if (!file) return;
    try {
      if (file.size > 20e6) throw new Error(`it has ${file.size} bytes; a scenario has at most 20 million`);
      const world = worldOf(await file.text(), file.name.replace(/\.json$/i, ""));
      this.stop();
      this.original = this.world = world;
      this.replay.show(world, this.replay.robot, [], `${world.name}: a scenario of your own.`);
      this.result.textContent = "";
    } catch (error) {
      this.result.textContent = `${file.name} cannot be driven in: ${error.message}.`;
    }
    this.file.value = "";
  }
}
