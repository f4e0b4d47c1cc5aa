// Drives policies in the page: each run goes to its end by the package's own kernels, and again whenever the scene changes.

const KEYBOARD = "you, by keyboard or pad";
const FRIEND = "a friend"; // what a link carries of a run by hand
const MOTORS = { ideal: "perfect", lagged: "normal", slow: "sluggish" };
const FAST = 6; // ms of a frame for the simulator
const WAITS = "Slow motion: the runs are still being computed.";
const WAITED = 50; // ms, of a frame that waits for it
const IDLE = 14; // ms at a time while nothing plays
const AHEAD = 3000; // ms to catch up at once
const [OUT, LOST] = [3, 12]; // s: out of the scene without coming nearer, in it without coming nearer than ever
const QUIET = 1500; // ms after a run by hand
const THERE = "in this scene";
const JAM = 10; // s: who stands still at least so long until the time is over is stuck
const UNENDED = { hits: [], stuck: Infinity, end: "", there: false }; // of a run: when which of its robots crashed, steps, words, whether its first robot of a team arrived
const LEAD = 40; // steps that all who drive are ahead of the picture
const REASONS = [["mpc", "solves its problem with OSQP"], ["ppo", ""], ["agent", ""],
  ["nav2", "keeps a cost map that the page does not carry"], ["central", "plans for all at once, in Python"], ...["team_guided", "team_scan", "people_free", "any_robot"].map((each) => [each, "its weights are not in this file"])]; // why not here

// Whether the cells of a world's map are not in the page.
const outlined = (world) => Boolean(world.walls && !world.grid);

// What was driven by hand, once more.
class Tape {
  constructor(run, simulator) {
    run.driven = []; // what all were asked for
    Object.assign(this, { run, step: 0, beside: simulator.crowd && pilotFor(simulator, "orca_team") });
  }

  // The others of a team drive by a law.
  act() {
    const { tape, driven } = this.run;
    const twist = tape[this.step++] || [0, 0, 0];
    driven.push(this.beside ? [twist, ...this.beside.act().slice(1)] : twist);
    return driven[driven.length - 1];
  }
}

class Drive {
  constructor(replay, kernels, free) {
    this.replay = replay;
    this.kernels = kernels;
    this.free = free; // whether the robot is chosen here
    this.runs = []; // what the page drives: what was asked, the actor, whether it is to be driven
    this.jobs = new Map(); // the runs that are driven now, with their simulators
    this.hand = null; // the run that is driven by hand
    this.held = new Set(); // keys that are down
    this.quiet = 0; // ms: until then a key that drove does nothing else
    this.fingers = new Map(); // the button of the pad that each finger is on, by its pointer
    const bodies = (replay.told.demo || {}).robots || {};
    const select = (label, options, change = () => {}) => {
      const box = el("select", { "aria-label": label, on: { change } }, options.map((each) => el("option", { value: each }, MOTORS[each] || bodies[each] || each.replace(/^delay_(\d+)$/, (_, count) => `delay of ${count} control period${count > 1 ? "s" : ""} (${short(count * DT)} s)`).replace("_", " "))));
      return [box, el("label", {}, label, box)];
    };
    const [who, whoLabel] = select("another robot", [], () => this.chosenPolicy());
    const [from, fromLabel] = select("the next robot begins at", ["the start", "this moment of the chosen robot"]);
    const [robot, robotLabel] = select("robot", robotsOf(kernels), () => { this.picked = true; this.embody(); });
    const [tier, tierLabel] = select("motors", kernels.tables.tiers, () => this.anew("with these motors"));
    const [disturbance, disturbanceLabel] = select("disturbance", Object.keys(kernels.tables.disturbances), () => this.anew());
    Object.assign(this, { who, from, robot, tier, disturbance });
    tier.value = "lagged";
    this.goButton = button("add this one", () => this.go());
    this.allButton = button("watch all", () => this.all());
    this.handButton = free ? null : button("drive it yourself", () => this.race.start()); // elsewhere it stands above the picture
    this.result = el("p", { class: "note result", role: "status" });
    this.cannot = el("p", { class: "note" });
    this.about = el("p", { class: "note about" });
    this.choice = el("div", { class: "choice" }, whoLabel, el("div", { class: "whole" }, this.goButton, this.allButton, this.handButton));
    this.pad = el("div", { class: "pad", hidden: true, role: "group", "aria-label": "drive by hand" });
    replay.quick.append(this.choice, this.pad, this.result, this.about);
    this.named = el("p", { class: "note" });
    this.conditionsPart = el("details", { class: "scenes" }, el("summary", {}, "Robot, motors and keys"),
      el("div", { class: "pick" }, free ? robotLabel : null, tierLabel, disturbanceLabel, fromLabel),
      el("p", { class: "note" }, "Arrows drive and turn; an omni base also moves sideways with A and D and turns with Q and E. Space plays and pauses, ← and → step while a replay is paused (a paused race drives on), F follows the robot, I and O zoom."));
    this.editor = new Editor(this);
    this.gains = new Gains(this);
    this.looks = new Looks(this);
    const labels = Object.keys(kernels.tables.pilots).map((key) => key.split(" ").slice(3).join(" ")).reverse().sort((a, b) => a.includes("(") - b.includes("("));
    if (free) for (const label of [...replay.told.demo.opening.runs.map(({ policy }) => policy), KEYBOARD, FRIEND, "ppo (trained)", ...RIVALS, ...labels]) rank(label); // each has its colour, in every tab and for a friend
    this.sheets = {}; // data sheets of robots of one's own, by name
    this.scenes = 0; // changes of the scene so far
    this.share = new Share(this);
    this.race = new Race(this);
    this.developersPart = el("details", { class: "drive" }, el("summary", {}, "For developers"),
      el("div", { class: "files" }, button("copy Python", () => this.share.python()), this.editor.files), this.named, this.gains.part,
      el("details", {}, el("summary", {}, "Files and exactness"), ["Drop on the picture, or open: a scenario, an image of a map (dark: obstacles), or a differential drive's data sheet.",
        "Runs without disturbance are those of Python to the last bit; disturbed runs have other noise. Robots shown together do not see or hit each other."].map((each) => el("p", { class: "note" }, each))),
      el("details", {}, el("summary", {}, "What the page cannot drive"), this.cannot));
    replay.side.append(this.share.part, this.editor.part, this.conditionsPart, this.developersPart);
    for (const part of replay.side.querySelectorAll("details")) part.addEventListener("toggle", () => { if (part.open && part.matches(":focus-within")) part.scrollIntoView({ block: "nearest" }); });
    replay.listeners.push(() => this.offer());
    this.wire();
    this.offer();
  }

  wire() {
    const { replay } = this;
    replay.advance = (due) => this.advance(due);
    replay.busy = () => Boolean(this.drives || this.runs.some((run) => run.pending && !run.actor.hidden));
    replay.driven = (event, down) => this.key(event, down);
    replay.races = () => this.drives;
    replay.poised = () => this.drives && !this.hand.tape.length && !replay.playing;
    replay.halts = () => {
      if (this.drives && this.hand.tape.length) this.hand.halted = true;
      this.race.back();
    };
    replay.aim = () => (this.drives ? this.hand.aim || 0 : replay.world.path ? Infinity : 0);
    replay.spoils = () => (this.hand ? !this.hand.actor.outcome : !still());
    replay.ends = () => this.race.tellScene();
    replay.waits = (actor) => this.runs.some((run) => run.actor === actor && run.pending);
    replay.leaves = (actor) => this.forget(this.runs.find((run) => run.actor === actor));
    replay.ready = () => this.ready();
    // while the hand drives, its keys do, wherever a click has left the focus; who came to a list by Tab works that
    document.addEventListener("pointerdown", () => { this.tabbed = false; }, true);
    document.addEventListener("keydown", (event) => {
      const { target, key } = event;
      if (key === "Tab") this.tabbed = true;
      const takes = /^(text|number)$/.test(target.type) || (this.tabbed && /INPUT|SELECT/.test(target.tagName));
      if (!takes && target !== replay.canvas && !this.editor.tool && !event.ctrlKey && !event.metaKey && !event.altKey) this.key(event, true);
    }, true);
    document.addEventListener("keyup", (event) => this.key(event, false));
    replay.canvas.addEventListener("blur", () => this.held.clear());
  }

  get task() {
    return taskOf(this.kernels, this.replay.world);
  }

  able() {
    return pilotsOf(this.kernels, this.task, this.replay.robot, this.tier.value);
  }

  // Who drives where nobody was chosen: a trained agent, the one of any robot, among bodies reciprocal avoidance.
  usual(labels) {
    return labels.find((each) => each.endsWith("(trained)") || each === "agent") || labels.find((each) => ["any_robot", "orca_team"].includes(each)) || labels[0];
  }

  // The robot that a scene opens with: one that a trained agent drives there, unless one was picked.
  robotFor(world) {
    const task = taskOf(this.kernels, world);
    const has = (robot) => pilotsOf(this.kernels, task, robot, this.tier.value).some((each) => each.endsWith("(trained)"));
    const { value } = this.robot;
    const there = robotsOf(this.kernels, task);
    return there.includes(value) && (this.picked || has(value)) ? value : there.find(has) || there[0];
  }

  // In a list: first who is first in the published results of such scenes, each by its best gains, then all others, those with other gains last.
  grouped(able) {
    const { demo } = this.replay.told;
    const first = ((demo && demo.best[this.replay.world.kind]) || []).map((name) => ["hand-tuned", "tuned", "trained"].map((gains) => `${name} (${gains})`).concat(name).find((each) => able.includes(each))).filter(Boolean);
    const others = able.filter((each) => !first.includes(each));
    const learned = (label) => label.endsWith("(trained)") || ["agent", "any_robot"].includes(label);
    const found = { "first in published results": first, networks: others.filter(learned), controllers: others.filter((each) => !learned(each) && !each.includes("(")), "controllers with other gains (settings)": others.filter((each) => !learned(each) && each.includes("(")) };
    return Object.fromEntries(Object.entries(found).filter(([, those]) => those.length));
  }

  // Which policies can drive here, and which cannot and why.
  offer() {
    const { replay, who } = this;
    if (replay.world !== this.world) { this.world = this.original = replay.world; this.editor.past = []; this.clear(); }
    this.robot.value = replay.robot;
    for (const each of this.robot.options) each.disabled = !robotsOf(this.kernels, this.task).includes(each.value); // too large for these scenes
    const told = replay.chosen && replay.chosen.told;
    if (told && told !== this.toldOf) { this.toldOf = told; this.tier.value = told.actuators; }
    const able = this.able();
    const shown = this.runs.find((run) => run.actor === replay.chosen); // who is looked at is who is chosen
    const before = shown && able.includes(shown.asked.label) ? shown.asked.label : who.value;
    who.replaceChildren(...Object.entries(this.grouped(able)).map(([label, those]) => el("optgroup", { label }, those.map((each) => el("option", { value: each, title: aboutOf(each) }, called(each))))));
    who.value = able.includes(before) ? before : this.usual(able);
    const others = replay.told.demo ? (replay.told.demo.unable || {})[replay.world.kind] || [] : [];
    const unable = [...new Set([...replay.actors.filter((actor) => actor.told && !able.includes(actor.policy)).map((actor) => actor.policy), ...others])];
    const reason = (label) => (REASONS.find(([start]) => label.startsWith(start)) || ["", "decides in NumPy"])[1];
    this.cannot.textContent = unable.length ? `Here: ${unable.map((each) => `${each}${reason(each) ? ` (${reason(each)})` : ""}`).join(", ")}.${this.free ? ` ${replay.told.demo.absent}` : ""}` : "";
    const known = Object.keys(this.kernels.tables.pilots).filter((key) => key.startsWith(`${this.task} `)).map((key) => key.split(" ")[3]);
    const elsewhere = [...new Set(known)].filter((name) => !able.some((label) => label.split(" ")[0] === name));
    if (elsewhere.length) this.cannot.textContent += ` With another robot: ${elsewhere.join(", ")}.`;
    if (!this.task) this.cannot.textContent = "Such scenarios are replayed; no policy can drive in them in the page.";
    if (outlined(replay.world)) this.cannot.textContent += " The map is too large for the page: here one drives among the walls of its outline, and runs are near those of Python, not the same to the last bit.";
    for (const each of [this.goButton, this.allButton, this.handButton]) if (each) each.disabled = !this.task;
    this.describe();
    this.race.tellScene();
  }

  // Who is chosen, in a phrase, and for Python.
  describe() {
    const { who: { value }, replay: { world } } = this;
    this.about.textContent = aboutOf(value);
    this.named.textContent = `In Python: ${value}${world.seed === undefined ? "" : ` in ${world.family}, no. ${world.seed} (Python counts from 0)`}.`;
    this.gains.offer();
  }

  // The policy of the list is the one whose gains are shown, and whose run is looked at where it drives.
  chosenPolicy() {
    const run = this.runs.find((each) => each.asked.label === this.who.value && !each.reference);
    if (run) this.replay.choose(run.actor);
    this.describe();
  }

  // A robot of one's own, from its data sheet, drives.
  adopt(content) {
    const sheet = sheetOf(content, this.kernels.tables.sheet);
    const { name } = sheet;
    if (!(name in this.sheets) && robotsOf(this.kernels).includes(name)) throw new Error(`name is ${JSON.stringify(name)}, which a robot of the page has: give it another one`);
    addRobot(this.kernels, sheet);
    this.sheets[name] = content;
    if (![...this.robot.options].some((each) => each.value === name)) this.robot.append(el("option", { value: name }, name));
    this.robot.value = name;
    this.embody();
    this.result.textContent = `${name} drives by its data sheet, with the laws that read nothing else: lqr, planners and agents drive it in Python.`;
  }

  // Another robot drives: what a hull docks at comes up to it.
  embody() {
    const { replay } = this;
    this.anew("with this robot", () => {
      const world = fitted(replay.world, HULLS[this.robot.value]);
      replay.robot = this.robot.value;
      if (world !== replay.world) this.world = this.original = world;
      replay.show(world, replay.robot, [], replay.told_of.textContent);
    });
  }

  // What was chosen takes effect at once: all who drive start again, in the pictures that there were, and who cannot is told; what was driven by hand goes.
  anew(where = "", change = () => {}) {
    const { replay, gains, drives, replay: { world, chosen, other }, looks: { on } } = this;
    const was = this.runs.filter(({ reference, asked: { label } }) => !reference && ![KEYBOARD, FRIEND].includes(label));
    this.clear();
    change();
    gains.values = {};
    this.offer();
    const able = this.able();
    const now = new Map();
    for (const { actor, asked } of was) {
      if (!able.includes(asked.label) || (asked.from && replay.world !== world)) continue;
      const run = this.add({ ...asked, gains: gains.kept(asked) }, false);
      run.actor.hidden = actor.hidden;
      now.set(actor, run.actor);
      gains.tell(run);
    }
    gains.key = null; // its sliders are laid anew
    if (now.size) {
      replay.choose(now.get(chosen) || replay.actors.find((actor) => !actor.told));
      replay.split(now.get(other));
      replay.seek(0);
      this.catchUp();
      replay.toggle(true);
    } else if (this.free && !replay.blank) this.go(false);
    const gone = was.filter(({ actor }) => !now.has(actor)).map(({ actor }) => actor.label);
    if (gone.length) this.result.textContent = `${gone.length > 2 ? `${gone.length} of the robots` : gone.join(" and ")} cannot drive ${where}${now.size ? "" : `: ${called(this.who.value)} drives`}.`;
    if (on) this.looks.turn(true);
    if (drives && where !== THERE) this.race.start();
  }

  conditions() {
    return { robot: this.replay.robot, actuators: this.tier.value, disturbance: this.disturbance.value, seed: 1 };
  }

  // Drives what is chosen; `play` also takes the focus to the picture, which only a click may do.
  go(play = true, label = this.who.value) {
    const { replay } = this;
    const from = this.from.value === "the start" ? null : replay.chosen;
    const step = from ? Math.min(replay.step, from.x.length - 1) : 0;
    this.result.textContent = this.editor.covered();
    if (this.replay.blank) this.editor.take(null);
    if (label === KEYBOARD) this.takeOver(from, step);
    else if (label) this.add({ label, from, step });
    replay.seek(step);
    this.catchUp();
    if (play) { replay.canvas.focus({ preventScroll: true }); replay.canvas.scrollIntoView({ block: "nearest" }); }
    if (label !== KEYBOARD && (play || !still())) replay.toggle(true);
  }

  all() {
    if (this.replay.blank) this.editor.take(null);
    this.result.textContent = this.editor.covered();
    for (const label of this.able()) if (!this.runs.some((run) => run.asked.label === label && !run.asked.from)) this.add({ label }, false);
    this.replay.split(null);
    this.offer();
    this.replay.seek(0);
    this.replay.toggle(true);
    this.wake();
  }

  // Adds a run of a policy; the one that it had from the start goes.
  add({ label, from = null, step = 0, gains = {}, reference = false, tape = [] }, choose = true) {
    const { replay } = this;
    const conditions = this.conditions();
    this.forget(this.runs.find((run) => run.asked.label === label && Boolean(run.reference) === reference && !from && !run.asked.from), true);
    const about = reference ? "untouched" : from && label !== KEYBOARD ? `from ${(step * DT).toFixed(2)} s` : "";
    const kept = from && { ...from, x: Array.from(from.x).slice(0, step + 3), y: Array.from(from.y).slice(0, step + 3), heading: Array.from(from.heading).slice(0, step + 3), others: (from.others || []).map(({ x, y }) => ({ x: x.slice(0, step + 3), y: y.slice(0, step + 3) })), error: from.error && Array.from(from.error).slice(0, step + 3) };
    const actor = { version: 0, policy: label, label: about ? `${called(label)}, ${about}` : called(label), outcome: "", note: "", robot: conditions.robot, ghost: false, twin: Boolean(about) };
    const run = { asked: { label, from: kept, step, conditions, gains }, actor, pending: label !== KEYBOARD, reference, tape };
    this.placed(run);
    this.runs.push(run);
    replay.add(actor, choose);
    if (choose) this.replay.listeners.forEach((each) => each());
    this.wake();
    return run;
  }

  // Where a run begins is shown at once, before its turn comes, and nothing of what it drove before.
  placed(run) {
    const { actor, asked: { from, conditions } } = run;
    Object.assign(actor, { x: [], y: [], heading: [], others: [], error: this.replay.world.kind === "path" ? [] : null, version: actor.version + 1 });
    if (from) {
      this.note(actor, [from.x[0], from.y[0], from.heading[0]], from.error ? from.error[0] : 0, from.others.map(({ x, y }) => [x[0], y[0]]));
      return;
    }
    const key = JSON.stringify(conditions);
    if (!this.starts || this.starts.world !== this.replay.world || this.starts.scenes !== this.scenes || this.starts.key !== key) {
      const simulator = new Simulator(this.kernels, this.replay.world, conditions);
      simulator.reset();
      this.starts = { world: this.replay.world, scenes: this.scenes, key, pose: simulator.pose, error: this.errorOf(simulator), others: simulator.others };
      simulator.free();
    }
    this.note(actor, this.starts.pose, this.starts.error, this.starts.others);
  }

  // Driven by hand, against some that drive beside it: the clock waits for the first key.
  takeOver(from, step) {
    this.endHand();
    this.share.told.textContent = "";
    for (const label of from ? [] : this.race.rivals()) if (!this.runs.some((run) => run.asked.label === label)) this.add({ label }, false);
    const run = this.add({ label: KEYBOARD, from, step });
    this.replay.seek(step); // before there is a hand: it is shown with its simulator
    for (const actor of this.replay.actors) actor.seen = null; // how they end is told anew
    this.hand = run;
    this.replay.toggle(false);
    try {
      this.begin(run, true);
    } catch (error) {
      this.failed(run, error);
      return;
    }
    this.editor.take(null);
    this.layPad();
    this.replay.pace(1);
    this.replay.fit();
    const { view } = this.replay;
    this.replay.leads = Math.min(view.width, view.height) < 480 && view.pixels < NEAR;
    if (this.replay.leads) this.replay.app.style.setProperty("--tall", "1");
    this.race.clear();
    this.race.tellScene();
    this.replay.listActors();
    window.scrollTo({ top: 0, behavior: "instant" }); // picture and pad in one view
    this.wake();
  }

  // The hand rests: the lists are there again in place of the pad.
  rest() {
    this.pad.hidden = true;
    this.choice.hidden = false;
    this.replay.app.classList.remove("driving");
  }

  layPad() {
    const omni = this.hand.simulator.body.axes.length > 2;
    const keys = omni ? [["turn left", "q"], ["ahead", "ArrowUp"], ["turn right", "e"], ["go left", "a"], ["back", "ArrowDown"], ["go right", "d"]]
      : [["left", "ArrowLeft"], ["ahead", "ArrowUp"], ["right", "ArrowRight"], null, ["back", "ArrowDown"], null];
    this.pad.replaceChildren(...keys.map((each) => (each === null ? el("span") : el("button", { type: "button", on: {
      pointerdown: (event) => {
        event.preventDefault();
        if (event.target.hasPointerCapture(event.pointerId)) event.target.releasePointerCapture(event.pointerId); // a finger may slide to the next button
        this.touch(event, each[1]);
      },
      pointerenter: (event) => { if (event.buttons) this.touch(event, each[1]); }, pointerup: (event) => this.touch(event), pointercancel: (event) => this.touch(event),
      pointerleave: (event) => this.touch(event), contextmenu: (event) => event.preventDefault(),
      keydown: (event) => { if (event.key === " " || event.key === "Enter") this.press(each[1], true); }, keyup: () => this.press(each[1], false) }, "data-key": each[1] }, each[0]))));
    this.pad.hidden = false;
    this.choice.hidden = true;
    this.replay.app.classList.add("driving");
  }

  get drives() {
    return Boolean(this.hand) && !this.hand.actor.outcome;
  }

  press(key, down) {
    if (!down) { this.held.delete(key); return; }
    if (!this.drives) return;
    this.held.add(key);
    this.race.go();
  }

  // A finger, or the mouse, came onto a button of the pad, or left it.
  touch({ pointerId }, key) {
    this.fingers.delete(pointerId);
    if (key && this.drives) {
      this.fingers.set(pointerId, key);
      this.race.go();
    }
    for (const each of this.pad.children) each.classList.toggle("down", [...this.fingers.values()].includes(each.dataset.key));
  }

  letGo() {
    this.held.clear();
    this.fingers.clear();
    for (const each of this.pad.children) each.classList.remove("down");
  }

  key(event, down) {
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "w", "a", "s", "d", "q", "e"].includes(key)) return false;
    const now = performance.now();
    if (!this.drives && now > this.quiet) return false;
    if (event.repeat) this.quiet = now + QUIET; // still held down
    event.preventDefault();
    this.press(key, down);
    return true;
  }

  twistByHand(simulator) {
    const [fast, turn] = [simulator.world.speed || 0.6, 1.5];
    const down = new Set([...this.held, ...this.fingers.values()]);
    const on = (...keys) => (keys.some((key) => down.has(key)) ? 1 : 0);
    const omni = simulator.body.axes.length > 2;
    return [fast * (on("ArrowUp", "w") - on("ArrowDown", "s")), omni ? fast * (on("a") - on("d")) : 0,
      turn * (on("ArrowLeft", "q") - on("ArrowRight", "e") + (omni ? 0 : on("a") - on("d")))];
  }

  endHand() {
    this.race.clear();
    this.rest();
    this.replay.edge = null;
    if (!this.hand) return;
    if (this.replay.leads) this.replay.whole();
    this.replay.pace(PLAYBACK);
    if (this.hand.simulator) this.hand.simulator.free();
    if (!this.hand.actor.outcome) this.hand.actor.note = "stopped";
    const { actor, tape } = this.hand;
    this.hand.simulator = null;
    this.hand = null;
    this.letGo();
    if (!tape.length) this.replay.takeOut(actor);
  }

  forget(run, listed = false) {
    if (!run) return;
    this.abort(run);
    if (this.hand === run) this.endHand();
    this.runs = this.runs.filter((each) => each !== run);
    if (listed) this.replay.actors = this.replay.actors.filter((actor) => actor !== run.actor);
    if (run.over) this.gains.untouched(run.asked.label);
  }

  clear() {
    this.share.told.textContent = "";
    this.replay.cut();
    this.looks.turn(false);
    this.abort();
    this.endHand();
    for (const run of this.runs) this.replay.actors = this.replay.actors.filter((actor) => actor !== run.actor);
    this.runs = [];
  }

  // Stops the runs that are driven now, or one of them: they begin anew when their turn comes.
  abort(...runs) {
    for (const run of runs.length ? runs : this.jobs.keys()) {
      if (this.jobs.has(run)) this.jobs.get(run).simulator.free();
      this.jobs.delete(run);
    }
  }

  failed(run, error) {
    run.pending = false;
    run.actor.note = `cannot be driven: ${error.message}`;
    this.result.textContent = `${run.actor.label} cannot be driven: ${error.message}`;
    if (this.hand === run) { this.hand = null; this.forget(run, true); this.replay.listActors(); }
  }

  begin(run, byHand = false) {
    const { replay } = this;
    const { from, step, conditions, label, gains } = run.asked;
    const simulator = new Simulator(this.kernels, replay.world, conditions);
    try {
      const draft = { x: [], y: [], heading: [], error: replay.world.kind === "path" ? [] : null, others: [], ...UNENDED, hits: [] };
      const note = this.again(simulator, run.asked);
      if (from) for (let k = 0; k < step; k++) this.note(draft, [from.x[k], from.y[k], from.heading[k]], from.error ? from.error[k] : 0, from.others.map(({ x, y }) => [x[k], y[k]]));
      this.note(draft, simulator.pose, this.errorOf(simulator), simulator.others);
      if (byHand) run.tape = [];
      const pilot = [KEYBOARD, FRIEND].includes(label) ? new Tape(run, simulator) : pilotFor(simulator, label, gains);
      if (!pilot) throw new Error("the page has no such policy for this robot");
      run.exact = note;
      run.field = boundsOf(replay.world, []).shown;
      // what is shown already stays until the new run is there
      if (run.actor.x.length < 2) Object.assign(run.actor, draft, { outcome: "", stale: false, version: run.actor.version + 1 });
      const target = run.actor.x === draft.x ? run.actor : draft;
      if (byHand) Object.assign(run, { simulator, target, pilot });
      else this.jobs.set(run, { simulator, pilot, target });
    } catch (error) {
      simulator.free();
      throw error;
    }
  }

  again(simulator, { from, step, conditions }) {
    simulator.reset();
    if (!from || !step) return "";
    const { told, gains } = from;
    const here = told ? told.plant === "kinematic" && told.actuators === conditions.actuators && told.disturbance === "none" && (!told.agent || told.agent === "0") : true;
    const same = here && this.replay.world === this.original && !outlined(this.replay.world) && conditions.disturbance === "none";
    const before = same && from.policy !== KEYBOARD ? pilotFor(simulator, from.policy, gains || {}) : null;
    if (before) {
      for (let k = 0; k < step; k++) simulator.step(before.act());
      return `from ${(step * DT).toFixed(2)} s of ${from.label}`;
    }
    if (simulator.crowd) throw new Error("among others a run begins at the start, or goes on from one that the page has driven here");
    const [a, b] = [Math.max(step - 2, 0), Math.min(step + 2, from.x.length - 1)];
    const heading = from.heading[step];
    const span = Math.max(b - a, 1) * DT;
    const [vx, vy] = [(from.x[b] - from.x[a]) / span, (from.y[b] - from.y[a]) / span];
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const turn = (from.heading[b] - from.heading[a]) / span;
    const wrapped = Math.atan2(Math.sin(heading), Math.cos(heading));
    simulator.takeUp([from.x[step], from.y[step], wrapped], [c * vx + s * vy, simulator.body.axes.length > 2 ? c * vy - s * vx : 0, turn], from, step);
    return `from the rounded pose at ${(step * DT).toFixed(2)} s of ${from.label}`;
  }

  note(target, [x, y, heading], error, others) {
    const last = target.heading.length ? target.heading[target.heading.length - 1] : heading;
    target.x.push(x);
    target.y.push(y);
    target.heading.push(last + Math.atan2(Math.sin(heading - last), Math.cos(heading - last)));
    if (target.error) target.error.push(error);
    others.forEach((at, k) => {
      target.others[k] = target.others[k] || { x: [], y: [] };
      target.others[k].x.push(at[0]);
      target.others[k].y.push(at[1]);
    });
  }

  errorOf(simulator) {
    return simulator.world.kind === "path" ? simulator.state.get("cross_track_error") : 0;
  }

  // A step of a run; returns whether it has ended.
  tick(run, simulator, twist, target) {
    const flags = simulator.step(twist);
    this.note(target, simulator.pose, this.errorOf(simulator), simulator.others);
    simulator.ends.forEach((end, row) => { if (end === "collision" && !target.hits.some(([, each]) => each === row)) target.hits.push([target.x.length - 1, row]); });
    const over = run === this.hand ? this.astray(run) || target.hits.length > 0 : target.x.length - 1 === run.asked.step + run.tape.length; // a tape's end
    if (!flags.ended && !over && target.x.length <= (this.replay.world.steps || 2400)) return false;
    this.finish(run, target, flags.success ? "success" : flags.collision ? "collision" : flags.left_corridor ? "left_corridor" : over ? (this.outside(run, simulator) ? "left" : "stopped") : "timeout", simulator);
    return true;
  }

  // All within the grey band along a line is in the scene.
  outside({ field: [left, bottom, right, top] }, { pose: [x, y], world: { path = [], closed, corridor } }) {
    if (x >= left && y >= bottom && x <= right && y <= top) return false;
    return (closed ? [...path, path[0]] : path).every((point, k, line) => !k || distanceTo(shapeOf.wall(line[k - 1], point), x, y) > corridor);
  }

  // Whether a run by hand is over: for some seconds it has come no nearer, out of the scene, or in it while nobody else drives.
  astray(run) {
    const { simulator: { world, state, alive, pose: [x, y] } } = run;
    const out = this.outside(run, run.simulator);
    [run.out, this.replay.edge] = [out, out && !world.path ? run.field : null]; // a line has its band
    const { waypoints = [], goal } = world;
    const aim = waypoints.length ? Number(state.get("waypoint")) : 0;
    if (aim !== run.aim) [run.aim, run.left, run.least] = [aim, Infinity, Infinity]; // the next place may lie farther away
    const [gx, gy] = waypoints[aim] || goal || [];
    const left = goal ? Math.hypot(gx - x, gy - y) : -state.get("arc_length");
    run.away = (out || this.race.late) && alive[0] && !(left < (out ? run.left : run.least)) ? (run.away || 0) + 1 : 0;
    run.grows = left - run.left > 0.02 * DT; // m: faster than it shakes
    [run.left, run.least] = [left, Math.min(left, run.least)];
    run.limit = (out ? OUT : LOST) / DT;
    return run.away > run.limit;
  }

  // How a run ended that did not arrive: of a team how many robots crashed, and who stood still for the rest of the time.
  ending(run, target, { alive, ends }) {
    const last = target.x.length - 1;
    const still = ({ x, y }) => {
      let k = last;
      while (k && Math.hypot(x[k - 1] - x[last], y[k - 1] - y[last]) < HULLS[this.replay.robot]) k -= 1;
      return k;
    };
    const since = [target, ...target.others].slice(0, alive.length).map((each, row) => (alive[row] ? still(each) : last)).filter((k) => last - k >= JAM / DT);
    const crashed = ends.filter((each) => each === "collision").length;
    const all = ends.length;
    const stuck = since.length ? Math.max(...since) : Infinity;
    const parts = [[all > 1 && crashed, `crashed${crashed > 1 ? ", the first" : ""} after`, (target.hits[0] || [])[0]], [since.length, "stuck since", stuck]].filter(([count]) => count);
    const told = parts.map(([count, how, k], nth) => `${all === 1 ? "" : count === all ? `all ${all} robots ` : `${count}${nth ? "" : ` of ${all} robots`} `}${how} ${(k * DT).toFixed(2)} s`);
    return { there: ends[0] === "success", stuck: crashed ? Infinity : stuck, end: all === 1 && stuck === 0 && this.lost(run) ? "finds no way wide enough" : told.join("; ") };
  }

  // Whether it plans its way, and there is none.
  lost(run) {
    const { look } = this.looks.run(run.actor) || {};
    return Boolean(look) && look.kind === "way" && this.jobs.get(run).pilot.look().every(Number.isNaN);
  }

  finish(run, target, outcome, simulator) {
    const { actor } = run;
    if (target !== actor) Object.assign(actor, target, { version: actor.version + 1 });
    Object.assign(actor, { outcome }, outcome === "success" || run.tape.length ? {} : this.ending(run, actor, simulator));
    if (outcome === "timeout" && actor.stuck < Infinity) actor.outcome = outcome = "stuck";
    run.pending = actor.stale = false;
    run.measures = this.measured(actor);
    actor.note = [run.exact, !actor.end && `${run.measures.time.toFixed(2)} s`, run.measures.error === null || outcome !== "success" ? "" : `typically ${millimetres(run.measures.error)} mm off`].filter(Boolean).join(", ");
    if (run === this.hand) {
      if (this.replay.leads) this.replay.whole();
      this.quiet = performance.now() + QUIET;
      this.race.over(run);
    }
    else this.race.tell();
    if (run === this.hand || this.runs.length === 1) say(`${actor.label}: ${actor.end || `${OUTCOMES[outcome]} after ${run.measures.time.toFixed(2)} s`}.`);
    this.replay.listActors();
    this.gains.compare();
  }

  // What a run is compared by.
  measured(actor) {
    const { world } = this.replay;
    const last = actor.x.length - 1;
    const solid = (world.bodies || solidsOf(world).length > 0) && !BOXES[actor.robot];
    let length = 0;
    for (let k = 1; k <= last; k++) length += Math.hypot(actor.x[k] - actor.x[k - 1], actor.y[k] - actor.y[k - 1]);
    return { outcome: actor.outcome, time: last * DT, error: actor.error ? rmsOf(actor, last) : null, speed: length / (last * DT), length,
      clearance: solid ? Math.min(...clearances(actor, world)) : null };
  }

  // What is to be driven next: while the picture plays whoever is not ahead of it, else the run of its panes before all others,
  // and of the others one to its end.
  next() {
    const { chosen, other, playing, step } = this.replay;
    const pending = this.runs.filter((run) => run.pending);
    const far = (run) => (this.jobs.has(run) ? this.jobs.get(run).target.x.length : 0);
    const late = playing && pending.filter((run) => !run.actor.hidden && far(run) < step + LEAD).sort((a, b) => far(a) - far(b))[0];
    const of = (actor) => pending.find((run) => run.actor === actor);
    return late || of(chosen) || of(other) || pending.find((run) => this.jobs.has(run)) || pending[0];
  }

  // How far all have been driven that come into the picture as they are: it waits for them, but not while the hand drives.
  ready() {
    const under = this.runs.filter(({ actor, pending }) => pending && !actor.hidden);
    const fresh = under.filter((run) => (this.jobs.has(run) ? this.jobs.get(run).target === run.actor : run.actor.x.length < 2));
    return this.drives ? Infinity : Math.min(...fresh.map(({ actor }) => actor.x.length - 1));
  }

  // Drives what is to be driven for some milliseconds; returns whether anything is left.
  pump(budget) {
    const begun = performance.now();
    for (let run = this.next(); run; run = this.next()) {
      if (performance.now() - begun >= budget) return true;
      try {
        if (!this.jobs.has(run)) this.begin(run);
        const { simulator, pilot, target } = this.jobs.get(run);
        if (!this.tick(run, simulator, pilot.act(), target)) continue;
      } catch (error) {
        this.failed(run, error);
      }
      this.abort(run);
    }
    return false;
  }

  // While the picture plays: the hand in the time that has passed, the others as far as the frame has room.
  advance(due) {
    const { hand, replay } = this;
    if (hand && !hand.actor.outcome) {
      if (!hand.tape.length) this.race.go();
      if (due < hand.actor.x.length - 2) hand.halted = true; // it was wound back
      if (replay.rate < (hand.slow ?? 1)) hand.slow = replay.rate;
      const until = Math.min(due, hand.actor.x.length + 40);
      while (hand.actor.x.length - 1 < until) {
        hand.tape.push(this.twistByHand(hand.simulator));
        if (this.tick(hand, hand.simulator, hand.pilot.act(), hand.target)) { this.letGo(); break; }
      }
      if (this.drives) this.race.watch();
      replay.view.takeIn([hand.actor.x[hand.actor.x.length - 1], hand.actor.y[hand.actor.y.length - 1]], 2 * HULLS[replay.robot]);
    }
    this.pump(this.ready() < due ? WAITED : this.looks.on ? 0.5 * FAST : FAST);
    replay.stretch();
    const now = performance.now();
    this.waitsFrom = !hand && this.ready() < due - 1 ? this.waitsFrom || now : 0;
    const waits = this.waitsFrom && now - this.waitsFrom > 600 ? WAITS : "";
    if ([waits, WAITS].includes(this.result.textContent || waits)) this.result.textContent = waits;
  }

  // Drives on while nothing plays.
  wake() {
    if (this.awake) return;
    this.awake = true;
    const turn = () => {
      const left = this.replay.playing ? Boolean(this.next()) : this.pump(IDLE);
      const now = performance.now();
      if (!this.replay.playing && (!left || now - (this.shownAt || 0) > 120)) {
        this.shownAt = now;
        this.replay.stretch();
        this.replay.refresh(true);
      }
      this.awake = left;
      if (left) setTimeout(turn, this.replay.playing ? 100 : 0);
    };
    setTimeout(turn, 0);
  }

  // Up to the moment that is shown, at once.
  catchUp() {
    this.pump(this.replay.playing ? FAST : 60);
    this.replay.stretch();
    this.wake();
  }

  // The scene is another: all that the page drives is driven again; until it is, its old track is pale, or none where all start anew.
  changed(anew = false) {
    this.abort();
    this.scenes += 1;
    if (this.hand) { // goes on from a tape: what was steered in the old scene
      const run = this.hand;
      this.endHand();
      run.pending = run.tape.length > 0;
    }
    for (const run of this.runs) if (run.asked.label !== KEYBOARD || run.tape.length) {
      run.pending = run.actor.stale = true;
      Object.assign(run.actor, UNENDED, { outcome: "", note: "" });
      if (anew) this.placed(run);
    }
    this.catchUp();
    this.replay.refresh(true);
  }
}
