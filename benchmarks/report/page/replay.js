// Pick a scenario, and see all policies drive it at once.

const RATES = [0.25, 0.5, 1, 2, 4, 8];
const OUTCOMES = { success: "success", collision: "collision", left_corridor: "left the corridor", timeout: "clock ran out" };

class Replay {
  constructor(told, packed) {
    this.told = told;
    this.packed = packed;
    this.step = 0;
    this.last = 1;
    this.rate = 1;
    this.playing = false;
    this.follows = false;
    this.scans = true;
    this.actors = [];
    this.chosen = null;
    this.world = { kind: "goal" };
    this.robot = "p3dx";
    this.listeners = [];
    this.build();
    themed.push(() => this.refresh());
    new ResizeObserver(() => this.refresh()).observe(this.canvas);
  }

  build() {
    this.canvas = el("canvas", { tabindex: "0", role: "application", "aria-label":
      "Replay. Space plays and pauses, left and right step, plus and minus change the speed, F follows the chosen robot." });
    this.view = new View(this.canvas);
    this.traces = [
      new Trace("error", "m", errorsOf, (k) => this.seek(k)),
      new Trace("speed", "m/s", speeds, (k) => this.seek(k)),
      new Trace("clearance", "m", clearances, (k) => this.seek(k)),
    ];
    const button = (text, label, click) => el("button", { type: "button", "aria-label": label, title: label, on: { click } }, text);
    this.playButton = button("▶", "play", () => this.toggle());
    this.scrubber = el("input", { type: "range", min: 0, max: 1, value: 0, "aria-label": "time", on: { input: () => this.seek(Number(this.scrubber.value)) } });
    this.rates = el("select", { "aria-label": "speed of the replay", on: { change: () => { this.rate = Number(this.rates.value); } } },
      RATES.map((rate) => el("option", { value: rate, selected: rate === 1 }, `${rate} ×`)));
    this.followButton = el("button", { type: "button", "aria-pressed": "false", on: { click: () => this.follow(!this.follows) } }, "follow");
    this.scanButton = el("button", { type: "button", "aria-pressed": "true", on: { click: () => {
      this.scans = !this.scans;
      this.scanButton.setAttribute("aria-pressed", this.scans);
      this.refresh();
    } } }, "scan");
    this.clock = el("span", { class: "clock" });
    this.list = el("ul", { class: "actors", "aria-label": "policies" });
    this.picks = el("div", { class: "pick" });
    this.told_of = el("p", { class: "note" });
    this.bar = el("div", { class: "bar" }, this.playButton, button("⇤", "to the start", () => this.seek(0)), button("|◀", "a step back", () => this.stepBy(-1)),
      button("▶|", "a step on", () => this.stepBy(1)), this.scrubber, this.clock, this.rates, this.followButton, this.scanButton,
      button("□", "fit the picture", () => { this.follow(false); this.fit(); }));
    this.board = el("div", { class: "board" }, this.canvas);
    this.below = el("div", {});
    byId("player").append(this.picks, el("div", { class: "stage" }, el("div", {}, this.board, this.bar, this.traces.map((trace) => trace.canvas)), this.list), this.told_of, this.below);
    this.wire();
  }

  wire() {
    const { canvas, view } = this;
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return; // the page scrolls until the picture is chosen
      event.preventDefault();
      view.zoomBy(Math.exp(-event.deltaY / 400), view.metres(event));
      this.refresh();
    }, { passive: false });
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.focus({ preventScroll: true });
      if (this.grab && this.grab(event)) return;
      from = [event.clientX, event.clientY];
      if (event.pointerType !== "touch") canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.drag && this.drag(event)) return;
      if (!from || !event.buttons || event.pointerType === "touch") return;
      this.follow(false);
      view.moveBy(event.clientX - from[0], event.clientY - from[1]);
      from = [event.clientX, event.clientY];
      this.refresh();
    });
    const end = (event) => { if (this.drop) this.drop(event); from = null; };
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (this.driven && this.driven(event, true)) return;
    const keys = {
      " ": () => this.toggle(), ArrowLeft: () => this.stepBy(event.shiftKey ? -20 : -1), ArrowRight: () => this.stepBy(event.shiftKey ? 20 : 1),
      Home: () => this.seek(0), End: () => this.seek(this.last), "+": () => this.faster(1), "-": () => this.faster(-1),
      f: () => this.follow(!this.follows),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }

  faster(sign) {
    const k = Math.min(Math.max(RATES.indexOf(this.rate) + sign, 0), RATES.length - 1);
    this.rate = RATES[k];
    this.rates.value = String(this.rate);
  }

  follow(on) {
    this.follows = on;
    this.followButton.setAttribute("aria-pressed", on);
    this.refresh();
  }

  show(world, robot, actors, about) {
    this.world = world;
    this.robot = robot;
    this.actors = actors;
    this.chosen = actors[0] || null;
    this.told_of.textContent = about;
    this.stretch();
    this.fit();
    this.seek(0);
    this.listActors();
    for (const run of this.listeners) run();
  }

  add(actor) {
    this.actors.push(actor);
    this.chosen = actor;
    this.stretch();
    this.listActors();
  }

  stretch() {
    this.last = Math.max(1, ...this.actors.map((actor) => actor.x.length - 1));
    this.scrubber.max = String(this.last);
  }

  fit() {
    this.view.measure();
    this.view.fit(boundsOf(this.world, this.actors));
    this.refresh();
  }

  listActors() {
    this.list.parentElement.classList.toggle("alone", !this.actors.length);
    this.list.replaceChildren(...this.actors.map((actor) => {
      const shown = el("input", { type: "checkbox", checked: !actor.hidden, "aria-label": `show ${actor.label}`,
        on: { change: () => { actor.hidden = !shown.checked; this.refresh(true); } } });
      const bad = actor.outcome && actor.outcome !== "success";
      return el("li", { "data-chosen": actor === this.chosen ? "yes" : "no" }, shown, swatch(actor.policy),
        el("button", { type: "button", class: "name", "aria-pressed": actor === this.chosen, title: "choose: its scan, its traces, its view", on: { click: () => this.choose(actor) } }, actor.label),
        el("small", { class: bad ? "bad" : "" }, `${bad ? "✕ " : ""}${actor.outcome ? OUTCOMES[actor.outcome] : "drives"}${actor.note ? `, ${actor.note}` : ""}`));
    }));
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
    this.playButton.textContent = on ? "❚❚" : "▶";
    this.playButton.setAttribute("aria-label", on ? "pause" : "play");
    if (!on) return;
    if (this.step >= this.last) this.seek(0);
    let before = null;
    let due = this.step;
    const frame = (now) => {
      if (!this.playing) return;
      const begun = performance.now();
      due = (Math.abs(due - this.step) > 1 ? this.step : due) + (before === null ? 0 : (Math.min(now - before, 200) / 1000 / DT) * this.rate);
      before = now;
      if (this.advance) this.advance(Math.floor(due)); // a robot that drives now makes the time
      this.seek(Math.min(Math.floor(due), this.last));
      this.script = performance.now() - begun;
      if (this.step >= this.last && !this.live) this.toggle(false);
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
    this.scrubber.value = String(this.step);
    this.scrubber.setAttribute("aria-valuetext", `${(this.step * DT).toFixed(2)} s`);
    this.clock.textContent = `${(this.step * DT).toFixed(2)} of ${(this.last * DT).toFixed(2)} s`;
    this.refresh();
  }

  refresh(changed = false) {
    const { view, step, world, chosen } = this;
    view.measure();
    if (!view.width) return;
    const hull = HULLS[this.robot] || 0.25;
    if (this.follows && chosen) {
      const k = Math.min(step, chosen.x.length - 1);
      view.middle = [chosen.x[k], chosen.y[k]];
      view.zoom = Math.max(view.zoom, 2.5);
    }
    const context = view.begin();
    const pixel = 1 / view.pixels;
    drawWorld(context, world, step * DT, pixel);
    const shown = this.actors.filter((actor) => !actor.hidden);
    if (this.scans && chosen && !chosen.hidden && (world.walls || (world.obstacles && world.obstacles.length))) {
      const k = Math.min(step, chosen.x.length - 1);
      drawScan(context, world, step * DT, chosen.x[k], chosen.y[k], chosen.heading[k], pixel);
    }
    for (const actor of shown) if (actor !== chosen) drawActor(context, actor, step, hull, pixel, false);
    if (chosen && !chosen.hidden) drawActor(context, chosen, step, hull, pixel, true);
    if (this.overlay) this.overlay(context, pixel);
    // that of a rectangle is not what is drawn: it turns
    const clear = (world.walls || (world.obstacles && world.obstacles.length)) && !BOXES[this.robot];
    const able = this.traces.filter((trace) => trace.name !== "clearance" || clear);
    for (const trace of this.traces) trace.canvas.hidden = !able.includes(trace) || !shown.length;
    for (const trace of able) if (shown.length) trace.draw(shown, world, step, this.last, chosen && !chosen.hidden ? chosen : null, changed);
  }
}
