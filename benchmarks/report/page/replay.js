// Pick a scenario, and see all policies drive it at once.

const RATES = [0.25, 0.5, 1, 2, 4, 8];
// Root mean square of a path follower's error up to a step, by arc length as the tables have it.
function rmsOf(actor, step) {
  let [sum, length] = [0, 0];
  for (let k = 1; k <= step; k++) {
    const ds = Math.hypot(actor.x[k] - actor.x[k - 1], actor.y[k] - actor.y[k - 1]);
    sum += actor.error[k] * actor.error[k] * ds;
    length += ds;
  }
  return length ? Math.sqrt(sum / length) : 0;
}

const OUTCOMES = { success: "arrived", collision: "crashed", left_corridor: "left the path", timeout: "ran out of time", left: "drove off", stopped: "stopped", stuck: "got stuck" };
const companyOf = ({ kind }) => (kind === "team" ? "team" : "people"); // the other bodies, in a word
const CROWDED = 4; // runs in a picture, from which on all but the chosen one are thin
const CHART = 90; // px that the picture leaves to the first of the charts
const PLAYBACK = 2; // times as fast as the robots
const UNENDING = 600; // steps that the time slider spans at least until the end is known

class Replay {
  constructor(told, packed) {
    this.told = told;
    this.packed = packed;
    this.step = 0;
    this.last = 1;
    this.rate = PLAYBACK;
    this.playing = false;
    this.follows = false;
    this.leads = false; // whether the picture, a small one, is near the hand, or near one robot in a wide scene
    this.scans = false;
    this.plots = !told.demo;
    this.actors = [];
    this.chosen = null;
    this.world = { kind: "goal" };
    this.robot = "p3dx";
    this.listeners = [];
    this.spoils = () => false; // whether a result would come before its picture
    this.waits = () => false; // whether a run is still to be driven
    this.races = () => false; // whether a hand drives against the others
    this.poised = () => false; // whether the clock waits for the hand's first press
    this.halts = () => {}; // the picture was stopped
    this.cut = () => {}; // another scene begins, which is no part of a film
    this.aim = () => 0; // the first of the rings on the way that is drawn
    this.edge = null; // of the scene, for a hand that is beyond it
    this.holds = () => false; // whether it waits for a film
    this.build();
    themed.push(() => this.refresh(true));
    new ResizeObserver(() => this.refresh()).observe(this.canvas);
  }

  build() {
    this.canvas = el("canvas", { tabindex: "0", role: "application", "aria-label":
      "Simulator. Space plays and pauses, left and right step, plus and minus change the speed, F follows the chosen robot, I and O zoom in and out." });
    this.view = new View(this.canvas);
    this.beside = el("canvas", { class: "beside", hidden: true, role: "img", "aria-label": "the other run at the same moment" });
    this.otherView = new View(this.beside);
    this.other = null; // the actor of the second pane; null: there is one pane
    const pane = (side, change) => el("select", { class: `pane ${side}`, hidden: true, "aria-label": side === "left" ? "first run" : "second run", on: { change: (event) => change(this.actors[Number(event.target.value)]) } });
    this.panes = [pane("left", (actor) => this.sides(actor, actor === this.other ? this.chosen : this.other)), pane("right", (actor) => this.sides(actor === this.chosen ? this.other : this.chosen, actor))];
    this.traces = [
      new Trace("error", "m", errorsOf, (k) => this.seek(k)),
      new Trace("speed", "m/s", speeds, (k) => this.seek(k)),
      new Trace("clearance", "m", clearances, (k) => this.seek(k)),
    ];
    this.playButton = button("play", () => this.toggle(), { class: "play" });
    this.scrubber = el("input", { type: "range", min: 0, max: 1, value: 0, "aria-label": "time", on: { input: () => this.seek(Number(this.scrubber.value)) } });
    this.rates = el("select", { "aria-label": "speed of the replay", title: "speed", on: { change: () => { this.rate = Number(this.rates.value); } } },
      RATES.map((rate) => el("option", { value: rate, selected: rate === PLAYBACK }, `${rate}x`)));
    this.followButton = button("follow robot", () => { if (this.follows) this.whole(); else this.follow(true); }, { class: "stepwise", "aria-pressed": "false", title: "the picture goes with the chosen robot" });
    this.scanButton = button("laser rays", () => this.rays(!this.scans), { "aria-pressed": "false" });
    this.chartButton = button("charts", () => this.plot(!this.plots), { "aria-pressed": String(this.plots), title: "distance, speed and clearance over time" });
    this.splitButton = button("two pictures", () => this.split(this.other ? null : this.actors.find((actor) => actor !== this.chosen && !actor.hidden)), { "aria-pressed": "false", class: "kept", title: "two runs, a picture each" });
    this.clock = el("span", { class: "clock" });
    this.list = el("ul", { class: "actors", "aria-label": "runs" });
    this.order = el("p", { class: "note" });
    this.found = el("p", { class: "note" });
    this.picks = el("div", { class: "pick" });
    this.told_of = el("p", { class: "note" });
    this.fitButton = button("whole scene", () => this.whole(), { hidden: true, title: "the picture was moved or zoomed: back to all of it" });
    this.bar = el("div", { class: "bar" }, this.playButton, button("rewind", () => this.seek(0)),
      this.scrubber, this.clock, this.rates, this.followButton, this.fitButton, this.scanButton, this.splitButton,
      recordButton(this), this.chartButton);
    this.hint = el("p", { class: "hint", hidden: true, role: "status" });
    this.words = el("div", { class: "words" }, this.hint); // beside the picture, never over it
    this.board = el("div", { class: "board" }, this.canvas, this.beside, this.panes);
    this.quick = el("div", { class: "quick" });
    this.scenario = el("details", { open: true, class: "scenes" }, el("summary", {}, "Scene"), this.picks, this.told_of);
    this.side = el("div", { class: "side" }, this.order, this.list, this.found, this.scenario);
    this.app = el("div", { class: "app" }, this.board, this.quick, this.bar, this.side, el("div", { class: "traces" }, this.traces.map((trace) => trace.canvas)));
    byId("player").append(this.words, this.app);
    this.place = () => this.app.style.setProperty("--top", `${Math.round(this.app.getBoundingClientRect().top + window.scrollY) + (this.told.demo && this.plots && window.innerWidth > 820 && window.innerHeight > 500 ? CHART : 0)}px`);
    for (const above of [document.querySelector("header"), this.words]) new ResizeObserver(this.place).observe(above);
    this.place();
    this.wire();
  }

  wire() {
    const { canvas, view } = this;
    canvas.addEventListener("keydown", (event) => this.key(event));
    // while it is paused arrows step, wherever a click has left the focus, but in what takes arrows itself
    document.addEventListener("keydown", (event) => {
      const { target, key, defaultPrevented } = event;
      if (!defaultPrevented && this.paused && canvas.offsetParent && target !== canvas && /^Arrow(Left|Right)$/.test(key) && !/^(text|number|range|select-one)$/.test(target.type)) this.key(event);
    });
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return; // the page scrolls until the picture is chosen
      event.preventDefault();
      view.zoomBy(Math.exp(-event.deltaY / 400), view.metres(event));
      this.refresh();
    }, { passive: false });
    let from = null;
    const moves = (event) => event.pointerType !== "touch" || canvas.classList.contains("held");
    const fingers = new Map(); // on the picture: two of them zoom and move it, and the page stays
    const both = () => { const [[ax, ay], [bx, by]] = fingers.values(); return { clientX: (ax + bx) / 2, clientY: (ay + by) / 2, apart: Math.hypot(ax - bx, ay - by) }; };
    for (const touch of ["touchstart", "touchmove"]) canvas.addEventListener(touch, (event) => { if (event.touches.length > 1 && event.cancelable) event.preventDefault(); }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.focus({ preventScroll: true });
      if (event.pointerType === "touch") fingers.set(event.pointerId, [event.clientX, event.clientY]);
      if (fingers.size > 1) {
        from = null;
        if (this.letGo) this.letGo();
        return;
      }
      if (this.grab && this.grab(event)) return;
      from = [event.clientX, event.clientY];
      if (moves(event)) canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (fingers.size > 1) {
        const was = both();
        if (fingers.has(event.pointerId)) fingers.set(event.pointerId, [event.clientX, event.clientY]);
        const now = both();
        this.follow(false);
        view.zoomBy(now.apart / Math.max(was.apart, 1), view.metres(was));
        view.moveBy(now.clientX - was.clientX, now.clientY - was.clientY);
        this.refresh();
        return;
      }
      if (this.drag && this.drag(event)) return;
      if (!from || !event.buttons || !moves(event)) return;
      this.follow(false);
      view.moveBy(event.clientX - from[0], event.clientY - from[1]);
      from = [event.clientX, event.clientY];
      this.refresh();
    });
    const end = (event) => {
      fingers.delete(event.pointerId);
      if (this.drop) this.drop(event);
      from = null;
    };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (this.edits && this.edits(event)) { event.preventDefault(); return; }
    if (this.driven && this.driven(event, true)) return;
    const keys = {
      " ": () => this.toggle(), ArrowLeft: () => this.stepBy(event.shiftKey ? -20 : -1), ArrowRight: () => this.stepBy(event.shiftKey ? 20 : 1),
      Home: () => this.seek(0), End: () => this.seek(this.last), "+": () => this.faster(1), "-": () => this.faster(-1),
      f: () => this.followButton.click(), i: () => this.near(1.25), o: () => this.near(0.8),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }

  faster(sign) {
    const k = Math.min(Math.max(RATES.indexOf(this.rate) + sign, 0), RATES.length - 1);
    this.pace(RATES[k]);
  }

  pace(rate) {
    this.rate = rate;
    this.rates.value = String(rate);
  }

  near(factor) {
    this.view.zoomBy(factor);
    this.refresh();
  }

  whole() {
    this.follow(false);
    this.fit();
  }

  follow(on) {
    this.follows = on;
    this.leads = false;
    this.followButton.setAttribute("aria-pressed", on);
    this.refresh();
  }

  rays(on) {
    this.scans = on;
    this.scanButton.setAttribute("aria-pressed", on);
    this.refresh();
  }

  plot(on) {
    this.plots = on;
    this.chartButton.setAttribute("aria-pressed", on);
    this.place();
    this.refresh(true);
    if (on) this.traces[0].canvas.scrollIntoView({ block: "nearest" });
  }

  show(world, robot, actors, about) {
    this.world = world;
    this.robot = robot;
    this.actors = actors;
    this.chosen = actors[0] || null;
    this.told_of.textContent = about + (world.kind === "path" ? " How far a run is typically off its path is the root mean square (RMS) of the distance." : "");
    this.split(null);
    this.stretch();
    this.fit();
    const [x0, y0, x1, y1] = this.view.bounds;
    this.leads = !this.follows && this.view.width < 480 && x1 - x0 > 1.6 * (y1 - y0) && world.name !== "drawn" && !document.body.dataset.embed; // a line stays where it was drawn
    this.seek(0);
    this.listActors();
    for (const run of this.listeners) run();
  }

  // Two panes: the chosen run, and another one beside it; null puts both into one again.
  split(other) {
    this.other = other || null;
    this.beside.hidden = !other;
    const [x0, y0, x1, y1] = this.view.bounds;
    this.board.classList.toggle("split", Boolean(other));
    this.board.classList.toggle("stacked", Boolean(other) && x1 - x0 > 1.6 * (y1 - y0)); // a wide scene fills the picture so
    this.splitButton.setAttribute("aria-pressed", Boolean(other));
    this.listActors();
    this.view.stale = this.otherView.stale = true;
    this.refresh(true);
  }

  offerPanes() {
    const { chosen, other, actors } = this;
    if (other && (other === chosen || !actors.includes(other))) this.other = actors.find((actor) => actor !== chosen) || null;
    if (other && !this.other) this.split(null);
    this.splitButton.hidden = actors.length < 2;
    this.panes.forEach((pane, k) => {
      pane.hidden = !this.other;
      pane.replaceChildren(...actors.map((actor, n) => el("option", { value: n, selected: actor === (k ? this.other : chosen) }, this.nameOf(actor))));
    });
  }

  add(actor, choose = true) {
    this.actors.push(actor);
    if (choose || !this.chosen) this.chosen = actor;
    this.stretch();
    this.listActors();
  }

  stretch() {
    this.last = Math.max(1, ...this.actors.map((actor) => actor.x.length - 1));
    this.step = Math.min(this.step, this.last);
    this.tell();
  }

  get paused() {
    return !this.playing && this.actors.length > 0 && !this.races();
  }

  // Whether a race by hand is: there arrows drive on.
  get rests() {
    return !this.playing && this.races() && !this.poised();
  }

  // The clock; a run that still drives has no end yet.
  tell() {
    this.clock.classList.toggle("paused", this.paused && this.step < this.last);
    this.clock.classList.toggle("rests", this.rests);
    this.scrubber.max = String(this.busy && this.busy() ? Math.max(this.last, UNENDING) : this.last);
    this.scrubber.value = String(this.step);
    this.scrubber.setAttribute("aria-valuetext", `${(this.step * DT).toFixed(2)} s`);
    const end = this.busy && this.busy() ? "" : ` of ${(this.last * DT).toFixed(2)}`;
    this.clock.textContent = this.actors.length ? `${(this.step * DT).toFixed(2)}${end} s` : "";
  }

  fit() {
    this.view.measure();
    this.view.fit(boundsOf(this.world, this.actors));
    const [x0, y0, x1, y1] = this.view.bounds;
    this.app.style.setProperty("--tall", `${(y1 - y0) / (x1 - x0)}`); // on a phone the picture is no taller than its scene
    this.refresh();
    requestAnimationFrame(() => { this.view.stale = true; this.refresh(); }); // a size that came back within a frame tells no observer
  }

  // Whether the list tells how a run ends: nothing is given away of one that is still on its way in the picture.
  tells(actor) {
    if (!actor.outcome) return false;
    if (this.step >= actor.x.length - 1) actor.seen = actor.version;
    return Boolean(actor.told) || actor.seen === actor.version || !this.spoils();
  }

  // Whether the picture shows it before its end.
  underWay(actor) {
    return this.step < actor.x.length - 1;
  }

  // What the list tells of the moment and of the ends of runs.
  get endings() {
    return [this.step > 0, this.actors.indexOf(this.drawn), ...this.actors.map((actor) => (this.tells(actor) ? (this.underWay(actor) ? 1 : 2) : 0))].join();
  }

  // What runs are compared by, here, on a card and for medals: along a path by their error, as in the tables, a race by hand by time as all else.
  get byError() {
    return this.world.kind === "path" && (this.actors.some((actor) => actor.told) || !this.actors.some(({ policy }) => policy === KEYBOARD));
  }

  // That of a run that has arrived, the better the lower.
  score(actor) { // m or s
    const last = actor.x.length - 1;
    return this.byError ? rmsOf(actor, last) : last * DT;
  }

  rank(actor) {
    return this.score(actor) - (!this.byError && actor.policy === KEYBOARD ? 0.5 * DT : 0); // a tie is the hand's
  }

  // And in words.
  scored(score) {
    return this.byError ? `${millimetres(score)}\u00a0mm off` : `${score.toFixed(2)}\u00a0s`;
  }

  result(actor) {
    return this.scored(this.score(actor));
  }

  // Arrived, under way, failed: the better first.
  ranked(actors) {
    const of = new Map(actors.map((actor) => [actor, !this.tells(actor) ? [1, this.target(actor) ? this.rank(actor) : 1e9] : actor.outcome === "success" ? [0, this.rank(actor)] : [2, -actor.x.length]]));
    return [...actors].sort((a, b) => of.get(a)[0] - of.get(b)[0] || of.get(a)[1] - of.get(b)[1]);
  }

  // A run's name; of one controller with several gains it says which.
  nameOf({ label, policy, gains }) {
    const twin = this.actors.some((each) => each.policy !== policy && each.label.startsWith(`${label},`));
    return `${label}${Object.keys(gains || {}).length ? ", your gains" : twin ? ", default gains" : ""}`;
  }

  // What a hand has to beat, where it is known.
  target(actor) {
    return this.races() && actor.outcome === "success" ? `to beat: ${this.result(actor)}` : "";
  }

  // And who fails, and needs no beating.
  failing({ outcome }) {
    return !this.races() || !outcome || outcome === "success" ? "" : outcome === "collision" ? "crashes" : "does not arrive";
  }

  listActors() {
    const order = this.ranked(this.actors);
    const own = this.whose ? [el("br"), `${this.whose} The other robots are pale.`] : [];
    const sorted = `${order.some((actor) => this.tells(actor)) ? "The" : "At the end the"} ${this.byError ? "closest to the line" : "fastest"} comes first.`;
    this.order.replaceChildren(...(order.length < 2 ? [] : [sorted, ...own]));
    this.offerPanes();
    const held = this.list.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
    this.list.replaceChildren(...order.map((actor) => {
      const shown = el("input", { type: "checkbox", checked: !actor.hidden, "aria-label": `show ${actor.label}`,
        on: { change: () => { actor.hidden = !shown.checked; this.refresh(true); } } });
      const ended = this.tells(actor);
      const bad = ended && actor.outcome !== "success";
      const note = [ended ? `${this.underWay(actor) ? `${this.step && actor.policy !== KEYBOARD ? "driving; " : ""}at the end: ` : ""}${actor.end || OUTCOMES[actor.outcome]}` : this.step && this.step >= actor.x.length - 1 && this.waits(actor) ? "being computed" : this.target(actor) || this.failing(actor) || (!actor.outcome && actor.note) || (this.playing || this.step ? "driving" : "at the start"), ended ? actor.note : "", actor.ghost ? "recorded in the scene as it was" : ""].filter(Boolean).join(", ");
      return el("li", { "data-chosen": actor === this.chosen ? "yes" : "no" }, shown, swatch(actor.policy, actor.twin),
        button(this.nameOf(actor), () => this.choose(actor), { class: "name", "aria-label": actor.label, "aria-pressed": actor === this.chosen, title: aboutOf(actor.policy) }),
        button("×", () => this.takeOut(actor), { class: "drop-out", "aria-label": `take out ${actor.label}`, title: "take this run out" }),
        el("small", { class: bad ? "bad" : "" }, note));
    }));
    const kinds = Object.keys(FOUND).filter((kind) => order.some(({ label }) => label.includes(OWN[kind])));
    this.found.textContent = kinds.length ? `${kinds.map((kind) => `${OWN[kind].slice(2)}: ${kind === kinds[0] ? FOUND[kind] : FOUND[kind].replace("gains (settings) ", "")}`).join("; ")}.`.replace(/^./, (first) => first.toUpperCase()) : "";
    this.listed = this.endings;
    if (held) for (const each of this.list.querySelectorAll("[aria-label]")) if (each.getAttribute("aria-label") === held) each.focus({ preventScroll: true });
  }

  takeOut(actor) {
    if (this.leaves) this.leaves(actor);
    this.actors = this.actors.filter((each) => each !== actor);
    if (this.chosen === actor) this.chosen = this.actors[0] || null;
    this.stretch();
    this.listActors();
    this.refresh(true);
    for (const run of this.listeners) run();
  }

  // A pane each: who is chosen for one pane and was in the other changes places with who was there.
  sides(actor, other) {
    this.other = other;
    this.choose(actor);
  }

  choose(actor) {
    this.chosen = actor;
    this.listActors();
    this.refresh(true);
    for (const run of this.listeners) run();
  }

  toggle(on = !this.playing) {
    if (on === this.playing) return;
    this.playing = on;
    this.playButton.textContent = on ? "pause" : "play";
    this.tell();
    if (!on) { this.halts(); if (this.rests) this.refresh(); return; }
    this.listActors();
    if (this.step >= this.last && !(this.busy && this.busy())) this.seek(0);
    let before = null;
    let due = this.step;
    const frame = (now) => {
      if (!this.playing) return;
      if (this.filmed && this.holds()) { requestAnimationFrame(frame); return; }
      const begun = performance.now();
      due = (Math.abs(due - this.step) > 1 ? this.step : due) + (before === null ? 0 : (Math.min(now - before, this.filmed ? 1000 / FILM.rate : 200) / 1000 / DT) * this.rate);
      before = now;
      if (this.advance) this.advance(Math.floor(due)); // a robot that drives now makes the time
      const ready = this.ready ? this.ready() : Infinity;
      const waits = due > ready && this.step >= ready; // nothing new to draw
      due = Math.min(due, Math.max(ready, this.step));
      if (!waits) this.seek(Math.min(Math.floor(due), this.last));
      if (this.filmed) this.filmed();
      this.script = performance.now() - begun;
      if (this.step >= this.last && !(this.busy && this.busy())) this.toggle(false);
      else requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  stepBy(count) {
    this.toggle(false);
    this.seek(this.step + count);
  }

  seek(step) {
    this.step = Math.min(Math.max(step, 0), this.last);
    this.tell();
    this.refresh();
  }

  // Whose others are drawn: those of who is looked at, and once that run is over, or hidden, those of one that goes on.
  company(chosen, actors) {
    if (chosen && (!chosen.outcome || this.step < chosen.x.length)) return (chosen.others || []).length ? chosen : null;
    const least = chosen ? chosen.x.length : 0;
    return actors.filter(({ x, others = [] }) => others.length && x.length > least).sort((a, b) => b.x.length - a.x.length)[0] || chosen;
  }

  // Of several runs the one whose others are drawn.
  get drawn() {
    const shown = this.actors.filter(({ hidden }) => !hidden);
    return this.world.bodies && !this.other && shown.length > 1 ? this.company(shown.find((actor) => actor === this.chosen), shown) : null;
  }

  // And in words.
  get whose() {
    const { drawn, chosen, world } = this;
    if (!drawn) return "";
    const [all, of, are] = world.kind === "team" ? ["team", "that", "is"] : ["people", "those", "are"];
    if (drawn !== chosen && !chosen.hidden) return `${chosen.policy === KEYBOARD ? "Your run" : chosen.own ? "Your last run" : `The run of ${this.nameOf(chosen)}`} is over: now the ${all} of ${this.nameOf(drawn)} ${are} drawn.`;
    return `Each robot has its own ${all}: ${drawn.policy === KEYBOARD ? "yours" : `${of} of ${this.nameOf(drawn)}`} ${are} drawn.`;
  }

  // What is to be known of the picture, in it.
  get captions() {
    return [this.whose, this.world.path && this.world.goal && "Robots dodge obstacles here, and may cut corners of the line.",
      this.rests && `Paused: ${coarse() ? "a button of the pad" : "an arrow key"} drives on.`].filter(Boolean);
  }

  // Draws a pane: the scene at this moment, the actors in it, of one of them the scan and what it looks at.
  paint(view, actors, chosen, pane) {
    const { world, step } = this;
    const context = view.begin();
    const pixel = 1 / view.pixels;
    const hull = HULLS[this.robot] || 0.25;
    if (!this.blank) drawWorld(context, world, step * DT, pixel, this.aim());
    if (this.edge) drawEdge(context, this.edge, pixel);
    if (this.scans && chosen && (world.bodies || world.walls || (world.obstacles && world.obstacles.length))) {
      const k = Math.min(step, chosen.x.length - 1);
      drawScan(context, [...solidsAt(world, step * DT), ...bodiesAt(world, chosen, step, hull)], chosen.x[k], chosen.y[k], chosen.heading[k], pixel, colourName(chosen.policy));
    }
    if (this.under) this.under(view, chosen, pane);
    const company = world.bodies && this.company(chosen, actors);
    if (company) drawBodies(context, world, company, step, hull, pixel);
    const faint = (actor) => (company ? actor !== company : this.races()); // who drives among others than are drawn, or whom the hand passes through
    const top = (this.races() && actors.find(({ policy }) => policy === KEYBOARD)) || chosen; // on top, marked, and who stands there fades
    const at = ({ x, y }) => [x, y].map((each) => each[Math.min(step, each.length - 1)]);
    const under = (actor) => top && actor !== top && Math.hypot(at(actor)[0] - at(top)[0], at(actor)[1] - at(top)[1]) < 2 * hull;
    const hits = (actor) => hitsOf(world, actor, hull).filter(({ k, row }) => step >= k && (!row || actor === company)); // of a team those that are drawn
    const how = (actor) => ({ chosen: actor === chosen, faint: actor !== chosen && actor !== top && faint(actor), under: under(actor), thin: chosen && actors.length > CROWDED, mark: actor === top && actors.length > 1, hits: hits(actor) });
    actors.filter((actor) => actor !== chosen && actor !== top).forEach((actor, k) => drawActor(context, actor, step, hull, pixel, { ...how(actor), lane: LANES[k % LANES.length] * (actors.length > CROWDED ? 0.5 : 1) }));
    for (const actor of new Set([chosen, top])) if (actor) drawActor(context, actor, step, hull, pixel, how(actor));
    if (!this.blank) drawStars(context, world, pixel);
    if (this.leads && top) drawWay(context, view, world, pixel, at(top));
    const fate = (actor) => {
      const { what } = hits(actor).find(({ row }) => !row) || {};
      return what && (actor === top || actors.length <= CROWDED) ? `: hit ${what}` : step >= actor.stuck ? `: ${actor.end}` : "";
    };
    const told = !pane && !this.blank ? this.captions : [];
    const caption = told.length ? drawCaption(context, view, told, pixel) : [];
    const named = [...new Set([top, chosen, actors.find(({ policy }) => policy === FRIEND), ...actors])].filter(Boolean).map((actor) => ({ ...actor, top: actor === top, name: `${this.nameOf(actor)}${fate(actor)}` }));
    if (named.length > 1 || actors.some(fate)) drawNames(context, view, named, step, hull, pixel, company ? bodiesAt(world, company, step, hull) : [], this.blank ? [] : [...obstaclesAt(world, step * DT), ...[starOf(world)].filter(Boolean).map(([x, y]) => [x, y, 1, 0, 0, 0, 9 * pixel, 0])], caption);
    return context;
  }

  refresh(changed = false) {
    const { view, step, world, chosen } = this;
    view.measure();
    if (!view.width) return;
    const at = ({ x, y }) => [x, y].map((each) => each[Math.min(step, each.length - 1)]);
    if (this.follows && chosen) [view.middle, view.zoom] = [at(chosen), Math.max(view.zoom, 2.5)];
    if (this.leads && chosen) {
      const [, y0, , y1] = view.bounds;
      const all = this.races() ? this.poised() : !(this.playing || step) || this.other || this.canvas.classList.contains("held") || this.actors.some((actor) => Boolean(actor.hidden) === (actor === chosen));
      if (all) [view.zoom, view.middle] = [1, null]; // until the clock starts all of it is seen, its doors too
      else view.lead(at(chosen), world.goal, this.races() ? NEAR : Math.min(NEAR, view.height / (y1 - y0)));
    }
    const shown = this.actors.filter((actor) => !actor.hidden);
    this.fitButton.hidden = !view.middle || this.follows || (this.leads && this.races());
    this.followButton.hidden = !this.fitButton.hidden;
    this.scanButton.hidden = !(world.bodies || world.walls || (world.obstacles && world.obstacles.length)); // nothing to see
    if (this.endings !== this.listed) {
      this.listActors();
      if (this.ends) this.ends();
      this.refresh(changed); // of who is chosen now
      return;
    }
    if (this.other) {
      Object.assign(this.otherView, { bounds: view.bounds, zoom: view.zoom, middle: this.follows ? at(this.other) : view.middle, least: view.least });
      this.otherView.measure();
      this.paint(this.otherView, [this.other], this.other, 1);
    }
    const context = this.paint(view, this.other ? [chosen] : shown, chosen && !chosen.hidden ? chosen : null, 0);
    if (this.overlay) this.overlay(context, 1 / view.pixels);
    // that of a rectangle is not what is drawn: it turns
    const clear = (world.bodies || world.walls || (world.obstacles && world.obstacles.length)) && !BOXES[this.robot];
    const able = this.traces.filter((trace) => this.plots && shown.length && (trace.name !== "clearance" || clear));
    for (const trace of this.traces) trace.canvas.hidden = !able.includes(trace);
    for (const trace of able) trace.draw(shown, world, step, this.last, chosen && !chosen.hidden ? chosen : null, changed);
  }
}
