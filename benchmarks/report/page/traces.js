// Error, speed and clearance over time, under the replay and linked to its cursor.

function speeds({ x, y }) {
  const found = new Float64Array(x.length);
  for (let k = 0; k < x.length; k++) { // over five moments: poses are rounded
    const [a, b] = [Math.max(k - 2, 0), Math.min(k + 2, x.length - 1)];
    found[k] = b > a ? Math.sqrt((x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2) / ((b - a) * DT) : 0;
  }
  return found;
}

function errorsOf(actor, world) {
  if (actor.error) return actor.error;
  if (!world.goal) return new Float64Array(actor.x.length).fill(NaN);
  return actor.x.map((x, k) => Math.hypot(world.goal[0] - x, world.goal[1] - actor.y[k]));
}

function clearances(actor, world) {
  const hull = HULLS[actor.robot] || 0.25;
  return actor.x.map((x, k) => Math.min(clearanceAt(world, k * DT, x, actor.y[k], hull), ...bodiesAt(world, actor, k, hull).map((body) => distanceTo(body, x, actor.y[k]) - hull)));
}

class Trace {
  constructor(name, unit, values, seek) {
    this.name = name;
    this.unit = unit;
    this.values = values; // of an actor in a world
    this.kept = new WeakMap();
    this.canvas = el("canvas", { class: "trace", role: "img", "aria-label": `${name} (${unit}) over time; follows the cursor of the replay` });
    this.view = new View(this.canvas);
    this.last = 1;
    const at = (event) => seek(Math.round((event.clientX - this.canvas.getBoundingClientRect().left - 44) / (this.canvas.clientWidth - 52) * this.last));
    this.canvas.addEventListener("pointerdown", (event) => { this.canvas.setPointerCapture(event.pointerId); at(event); });
    this.canvas.addEventListener("pointermove", (event) => { if (event.buttons) at(event); });
  }

  of(actor, world) {
    const found = this.kept.get(actor);
    if (found && found.length === actor.x.length && found.version === actor.version) return found.made;
    const made = this.values(actor, world);
    this.kept.set(actor, { made, length: actor.x.length, version: actor.version });
    return made;
  }

  // The curves do not move with the cursor: they are drawn once, and copied under it.
  draw(actors, world, step, last, chosen, changed) {
    const { view } = this;
    view.measure();
    if (!view.width) return;
    const key = [view.width, last, chosen && chosen.policy, actors.length, actors.map((actor) => `${actor.x.length}.${actor.version || 0}`).join()].join("|");
    const now = performance.now(); // while runs grow, some times a second, for a small share of the time
    if (!this.picture || changed || (key !== this.key && now - this.drawnAt > Math.max(200, 40 * this.took))) {
      this.key = key;
      this.picture = this.curves(actors, world, last, chosen);
      this.drawnAt = performance.now();
      this.took = this.drawnAt - now;
    }
    const { context, ratio } = view;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, view.canvas.width, view.canvas.height);
    context.drawImage(this.picture, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const x = 44 + (view.width - 52) * Math.min(step / last, 1);
    context.strokeStyle = ink("--accent");
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x, 2);
    context.lineTo(x, view.height - 2);
    context.stroke();
    if (chosen) {
      const values = this.of(chosen, world);
      const value = values[Math.min(step, values.length - 1)];
      context.fillStyle = ink("--ink");
      context.textAlign = "right"; // in the corner: beside the cursor it would cover the name
      if (Number.isFinite(value)) context.fillText(`${short(Math.round(1e5 * value) / 1e5 || 0)} ${this.unit}`, view.width - 10, 12);
    }
  }

  curves(actors, world, last, chosen) {
    this.last = last;
    const { view } = this;
    const picture = document.createElement("canvas");
    [picture.width, picture.height] = [view.canvas.width, view.canvas.height];
    const context = picture.getContext("2d");
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    let [low, high] = [0, 1e-3];
    const all = actors.map((actor) => this.of(actor, world));
    for (const values of all) for (const value of values) if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
    const y = scale(low, high, view.height - 18, 18, false);
    const x = (k) => 44 + ((view.width - 52) * k) / last;
    context.font = "11px system-ui, sans-serif";
    view.context.font = context.font;
    context.fillStyle = ink("--faint");
    context.strokeStyle = ink("--line");
    for (const tick of ticks(low, high, false).filter((_, k, found) => k % Math.ceil(found.length / 4) === 0)) {
      context.beginPath();
      context.moveTo(44, y(tick));
      context.lineTo(view.width - 8, y(tick));
      context.stroke();
      context.textAlign = "right";
      context.fillText(short(tick), 40, y(tick) + 4);
    }
    context.textAlign = "center";
    for (const time of ticks(0, last * DT, false)) context.fillText(short(time), x(time / DT), view.height - 4);
    context.textAlign = "left";
    context.fillStyle = ink("--ink");
    const name = this.name === "error" && world.goal ? "distance to the star" : this.name;
    context.fillText(`${name} (${this.unit}) over time (s)`, 48, 12);
    actors.forEach((actor, i) => {
      context.strokeStyle = ink(colourName(actor.policy));
      context.lineWidth = actor === chosen ? 2.2 : 1.2;
      context.globalAlpha = chosen && actor !== chosen ? 0.55 : 1;
      context.setLineDash(dashOf(actor.policy).split(" ").filter(Boolean).map(Number));
      context.beginPath();
      const values = all[i];
      let pen = false;
      for (let k = 0; k < values.length; k++) {
        if (Number.isFinite(values[k])) { if (pen) context.lineTo(x(k), y(values[k])); else context.moveTo(x(k), y(values[k])); pen = true; } else pen = false;
      }
      context.stroke();
    });
    context.globalAlpha = 1;
    return picture;
  }
}
