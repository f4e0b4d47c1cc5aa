// Gains as sliders: the run is driven again while one pulls, and compared with the untouched one.

class Gains {
  constructor(drive) {
    this.drive = drive;
    this.label = null;
    this.values = {}; // what was changed, by label and gain
    this.about = el("p", { class: "note" });
    this.rows = el("div", {});
    this.deltas = el("table", { class: "deltas" });
    this.resetButton = button("reset", () => this.reset());
    this.tunedButton = button("tuned values", () => this.tuned());
    this.part = el("details", { class: "law" }, el("summary", {}, "Tune its gains"), this.about, el("div", { class: "files" }, this.resetButton, this.tunedButton), this.deltas, this.rows);
  }

  recipe(label = this.label) {
    const { drive } = this;
    const recipe = drive.kernels.tables.pilots[`${drive.task} ${drive.replay.robot} ${drive.tier.value} ${label}`];
    return recipe && gainsOf(drive.kernels, drive.task, recipe, drive.replay.world);
  }

  // Lays the sliders of the policy that is chosen.
  offer() {
    const label = this.drive.who.value;
    const recipe = this.recipe(label);
    const key = `${this.drive.task} ${this.drive.replay.robot} ${this.drive.tier.value} ${this.drive.replay.world.speed} ${label}`;
    if (key === this.key) return;
    this.key = key;
    this.label = label;
    const gains = (recipe && recipe.gains) || [];
    this.part.hidden = !gains.length;
    this.about.textContent = recipe && recipe.fixed && recipe.fixed.length ? `Of ${called(label)}. In Python also: ${recipe.fixed.join(", ")}.` : `Of ${called(label)}.`;
    this.tunedButton.hidden = !this.found(label);
    this.boxes = new Map();
    this.rows.replaceChildren(...gains.map((gain) => this.row(gain)));
    this.compare();
  }

  row(gain) {
    const { name, unit, value, low, high, whole } = gain;
    const now = (this.values[this.label] || {})[name] ?? value;
    const step = whole ? 1 : (high - low) / 200;
    const range = el("input", { type: "range", min: low, max: high, step, value: now, "aria-label": `${name}${unit ? `, ${unit}` : ""}` });
    const box = el("input", { type: "number", step: "any", value: short(now, 4), "aria-label": `${name} as a number` });
    const set = (next) => {
      if (!Number.isFinite(next)) return;
      const kept = whole ? Math.round(next) : next;
      range.value = String(kept);
      box.value = short(kept, 4);
      this.set(name, kept);
    };
    range.addEventListener("input", () => set(Number(range.value)));
    box.addEventListener("change", () => {
      const next = Number(box.value);
      if (!box.value.trim() || !(next >= low && next <= high)) {
        this.drive.result.textContent = `${name} is ${box.value || "empty"}; it must be from ${short(low)} to ${short(high)}${unit ? ` ${unit}` : ""}.`;
        box.value = short(Number(range.value), 4);
      } else set(next);
    });
    this.boxes.set(name, [range, box]);
    return el("div", { class: "gain" }, el("label", {}, `${name}${unit ? ` (${unit})` : ""}${gain.about ? `: ${gain.about}` : ""}`), range, box,
      button("↺", () => set(value), { "aria-label": `reset ${name}`, title: `${short(value, 4)}` }));
  }

  // A gain has another value: the policy's run is driven again, beside the untouched one.
  set(name, value) {
    const { drive, label } = this;
    const base = this.recipe().gains.find((gain) => gain.name === name).value;
    const mine = (this.values[label] = this.values[label] || {});
    const all = { ...Object.fromEntries(this.recipe().gains.map((gain) => [gain.name, gain.value])), ...mine, [name]: value };
    const crossed = this.recipe().gains.find((gain) => gain.above in all && all[gain.name] < all[gain.above]);
    drive.result.textContent = crossed ? `${crossed.name} must be at least ${crossed.above}, ${short(all[crossed.above])}.` : "";
    if (crossed) return;
    if (value === base) delete mine[name];
    else mine[name] = value;
    let run = drive.runs.find((each) => each.asked.label === label && !each.reference && !each.asked.from);
    if (!run) run = drive.add({ label });
    run.asked.gains = { ...mine };
    this.tell(run);
    drive.abort(run);
    run.pending = true;
    drive.replay.choose(run.actor);
    drive.catchUp();
    this.compare();
  }

  // A run has the gains that it was asked for; where they are one's own, the untouched run is beside it.
  tell(run) {
    const { drive } = this;
    const { label, gains } = run.asked;
    run.actor.gains = gains;
    run.over = Object.keys(gains).length > 0;
    if (run.over) this.values[label] = { ...gains };
    const untouched = drive.runs.find((each) => each.asked.label === label && each.reference);
    if (run.over && !untouched) drive.add({ label, reference: true }, false);
    if (!run.over && untouched) drive.forget(untouched, true);
  }

  // One's own gains of a run, where its policy can have them under what is chosen now.
  kept({ label, gains }) {
    try {
      return checkedGains(gains, this.recipe(label));
    } catch {
      return {};
    }
  }

  setAll(values) {
    for (const [name, value] of Object.entries(values)) {
      const boxes = this.boxes.get(name);
      if (!boxes) continue;
      boxes[0].value = String(value);
      boxes[1].value = short(value, 4);
      this.set(name, value);
    }
  }

  reset() {
    this.setAll(Object.fromEntries(this.recipe().gains.map((gain) => [gain.name, gain.value])));
  }

  found(label) {
    return this.recipe(`${label} (tuned)`) || this.recipe(`${label} (hand-tuned)`);
  }

  tuned() {
    this.setAll(Object.fromEntries(this.found(this.label).gains.map((gain) => [gain.name, gain.value])));
  }

  untouched(label) {
    delete this.values[label];
    this.key = null;
  }

  // What the change did: each number beside that of the untouched run.
  compare() {
    const { drive, label } = this;
    const [mine, base] = [false, true].map((reference) => drive.runs.find((run) => run.asked.label === label && Boolean(run.reference) === reference && !run.asked.from));
    this.deltas.replaceChildren();
    if (!mine || !base || !mine.measures || !base.measures) return;
    const row = (name, unit, written, key, lower) => {
      const [a, b] = [base.measures[key], mine.measures[key]];
      if (a === null || b === null) return null;
      const [delta, told] = [b - a, written(Math.abs(b - a))];
      const judged = lower === null || !Number(told) ? "" : (delta < 0) === lower ? "better" : "worse";
      return el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, `${written(a)} ${unit}`), el("td", {}, `${written(b)} ${unit}`),
        el("td", { class: judged }, `${!Number(told) ? "±" : delta > 0 ? "+" : "−"}${told}`));
    };
    this.deltas.append(el("thead", {}, el("tr", {}, ["", "untouched", "now", "change"].map((each) => el("th", { scope: "col" }, each)))),
      el("tbody", {}, el("tr", {}, el("th", { scope: "row" }, "outcome"), el("td", {}, OUTCOMES[base.measures.outcome]), el("td", {}, OUTCOMES[mine.measures.outcome]), el("td", {})),
        row("error", "mm", millimetres, "error", true), ...[["time", "s", true], ["speed", "m/s", null], ["clearance", "m", false]].map(([name, unit, lower]) => row(name, unit, (value) => short(value), name, lower))));
  }
}
