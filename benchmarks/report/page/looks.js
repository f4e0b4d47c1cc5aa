// What a law looks at, drawn over the picture: numbers of its own functions at the moment that is shown.

const LOOKING = 10; // ms of a frame to come to the moment that is shown
const KEPT_LOOKS = 600; // moments
const SHOWN = 2; // s: a velocity is drawn as where it leads in that time

// Where an arc leads from the pose at the origin, after some seconds.
function onArc(vx, vy, w, time) {
  const turn = w * time;
  const [sine, rest] = Math.abs(turn) < 1e-9 ? [time, 0] : [Math.sin(turn) / w, (1 - Math.cos(turn)) / w];
  return [vx * sine - vy * rest, vx * rest + vy * sine];
}

class Brush {
  constructor(context, pixel, [x, y, heading], hull) {
    Object.assign(this, { context, pixel, x, y, heading, hull });
  }

  world([u, v]) {
    const [c, s] = [Math.cos(this.heading), Math.sin(this.heading)];
    return [this.x + c * u - s * v, this.y + s * u + c * v];
  }

  line(points, colour, width, alpha = 1, dash = []) {
    const { context, pixel } = this;
    context.beginPath();
    for (const point of points) context.lineTo(...point);
    context.strokeStyle = ink(colour);
    context.lineWidth = width * pixel;
    context.globalAlpha = alpha;
    context.setLineDash(dash.map((each) => each * pixel));
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  dot([x, y], colour, size = 5) {
    const { context, pixel } = this;
    context.beginPath();
    context.arc(x, y, size * pixel, 0, 2 * Math.PI);
    context.fillStyle = ink(colour);
    context.fill();
  }

  circle([x, y], radius) {
    this.line(Array.from({ length: 61 }, (_, k) => [x + radius * Math.cos((k * Math.PI) / 30), y + radius * Math.sin((k * Math.PI) / 30)]), "--think", 1, 0.7, [4, 4]);
  }

  arrow([x, y], angle, length, colour, width = 3) {
    const end = [x + length * Math.cos(angle), y + length * Math.sin(angle)];
    const head = Math.min(0.35 * length, 9 * this.pixel);
    this.line([[x, y], end], colour, width);
    this.line([-2.6, 0, 2.6].map((turn) => (turn ? [end[0] + head * Math.cos(angle + turn), end[1] + head * Math.sin(angle + turn)] : end)), colour, width);
  }
}

const LOOKS = {
  point(brush, [px, py, distance]) {
    const { x, y, heading } = brush;
    const [dx, dy] = [px - x, py - y];
    const [u, v] = [Math.cos(heading) * dx + Math.sin(heading) * dy, Math.cos(heading) * dy - Math.sin(heading) * dx];
    const squared = u * u + v * v;
    if (distance > 0) brush.circle([x, y], distance);
    if (squared > 1e-6) {
      const curvature = (2 * v) / squared;
      const length = Math.abs(curvature) < 1e-6 ? u : (2 * Math.atan2(v, u)) / curvature;
      brush.line(Array.from({ length: 33 }, (_, k) => brush.world(onArc(1, 0, curvature, (length * k) / 32))), "--think", 2.5);
    }
    brush.line([[x, y], [px, py]], "--think", 1, 0.7, [3, 3]);
    brush.dot([px, py], "--think", 6);
  },

  offset(brush, [x, y, off, heading]) {
    const foot = [x + off * Math.sin(heading), y - off * Math.cos(heading)];
    brush.line([[x, y], foot], "--fail", 3);
    brush.arrow(foot, heading, 0.4, "--think");
    brush.dot([x, y], "--think");
  },

  field(brush, forces, { places, solid }) {
    let most = 0;
    for (let k = 0; k < forces.length; k += 2) if (!Number.isNaN(forces[k])) most = Math.max(most, Math.hypot(forces[k], forces[k + 1]));
    const room = 0.85 * Math.max(Math.abs(places[2] - places[0]), Math.abs(places[3] - places[1]));
    for (let k = 0; k < forces.length; k += 2) {
      const size = Math.hypot(forces[k], forces[k + 1]);
      if (!(size > 1e-9) || solid.some((each) => distanceTo(each, places[k], places[k + 1]) < 0)) continue;
      brush.context.globalAlpha = 0.75;
      brush.arrow([places[k], places[k + 1]], Math.atan2(forces[k + 1], forces[k]), room * (0.3 + (0.7 * size) / most), "--think", 1.3);
    }
  },

  sectors(brush, numbers) {
    const count = numbers.length / 4;
    if (!numbers[3 * count + 2]) return;
    const { context, x, y, hull } = brush;
    const width = (2 * Math.PI) / count;
    for (let k = 0; k < count; k++) {
      const from = k * width - Math.PI;
      const outer = hull + 0.12 + Math.min(numbers[k], 1.5) * 0.9;
      const closed = numbers[count + k] > 0;
      context.beginPath();
      context.arc(x, y, hull + 0.02, from, from + width);
      context.arc(x, y, outer, from + width, from, true);
      context.closePath();
      const reached = !(numbers[2 * count + k] > 0); // by its turning circles
      context.fillStyle = ink(closed || !reached ? "--fail" : "--think");
      context.globalAlpha = closed ? 0.55 : reached ? 0.4 : 0.25;
      context.fill();
    }
    context.globalAlpha = 1;
    brush.line([[x, y], [x + 1.6 * Math.cos(numbers[3 * count]), y + 1.6 * Math.sin(numbers[3 * count])]], "--goal", 2, 1, [5, 4]);
    if (!Number.isNaN(numbers[3 * count + 1])) brush.arrow([x, y], numbers[3 * count + 1], 1.3, "--think");
  },

  arcs(brush, numbers, { twist }) {
    const count = numbers.length / 4 - 1;
    const horizon = numbers[4 * count];
    const scores = Array.from({ length: count }, (_, k) => numbers[4 * k + 3]);
    if (Number.isNaN(scores[0])) return;
    const able = scores.filter((each) => each > -Infinity);
    const [low, high] = [Math.min(...able), Math.max(...able)];
    const along = (k) => Array.from({ length: 17 }, (_, i) => brush.world(onArc(numbers[4 * k], numbers[4 * k + 1], numbers[4 * k + 2], (horizon * i) / 16)));
    let driven = -1;
    for (let k = 0; k < count; k++) {
      if ([0, 1, 2].every((i) => numbers[4 * k + i] === twist[i])) driven = k;
      if (scores[k] > -Infinity) brush.line(along(k), "--think", 1, 0.15 + (0.6 * (scores[k] - low)) / Math.max(high - low, 1e-9));
      else brush.line(along(k), "--fail", 1, 0.3, [3, 3]);
    }
    if (driven >= 0) brush.line(along(driven), "--think", 3.5);
  },

  rollouts(brush, numbers, { shape: [rows, columns] }) {
    const row = (r) => {
      const steps = numbers[2 * columns * r + 1];
      return Array.from({ length: steps + 1 }, (_, t) => brush.world(t ? [numbers[2 * (columns * r + t)], numbers[2 * (columns * r + t) + 1]] : [0, 0]));
    };
    if (Number.isNaN(numbers[2 * columns * (rows - 1) + 1])) return;
    const order = Array.from({ length: rows - 1 }, (_, r) => [numbers[2 * columns * r], r]).filter(([cost]) => !Number.isNaN(cost)).sort(([a], [b]) => b - a);
    order.forEach(([cost, r], k) => brush.line(row(r), cost > 5 ? "--fail" : "--think", 1, 0.12 + (0.55 * k) / order.length));
    brush.line(row(rows - 1), "--think", 3.5);
  },

  // Velocities around the robot: what each half-plane takes away, the wanted one, and the nearest that is left.
  half_planes(brush, numbers) {
    const { context, x, y } = brush;
    const rows = numbers.length / 4 - 2;
    const [wx, wy, vx, vy, most] = numbers.slice(4 * rows, 4 * rows + 5);
    const reach = SHOWN * most;
    context.save();
    context.beginPath();
    context.arc(x, y, reach, 0, 2 * Math.PI);
    context.clip();
    for (let k = 0; k < rows && !Number.isNaN(numbers[4 * k]); k++) {
      const [nx, ny, bound, stands] = numbers.slice(4 * k, 4 * k + 4);
      const [fx, fy] = [x + SHOWN * bound * nx, y + SHOWN * bound * ny];
      const corner = (along, back) => [fx - along * ny - back * nx, fy + along * nx - back * ny];
      context.beginPath();
      for (const [along, back] of [[-3, 0], [3, 0], [3, 3], [-3, 3]]) context.lineTo(...corner(along * reach, back * reach));
      context.fillStyle = ink(stands ? "--solid" : "--fail");
      context.globalAlpha = 0.16;
      context.fill();
      brush.line([corner(-3 * reach, 0), corner(3 * reach, 0)], stands ? "--faint" : "--fail", 1, 0.7);
    }
    context.restore();
    brush.circle([x, y], reach);
    brush.line([[x, y], [x + SHOWN * wx, y + SHOWN * wy]], "--goal", 2, 1, [5, 4]);
    const speed = Math.hypot(vx, vy);
    if (speed > 1e-6) brush.arrow([x, y], Math.atan2(vy, vx), SHOWN * speed, "--think");
  },

  // What the network wanted, and what its guard and its limits left of that.
  guard(brush, numbers, { twist, wanted }) {
    brush.circle([brush.x, brush.y], numbers[0]);
    const along = ([vx, vy, w]) => Array.from({ length: 17 }, (_, k) => brush.world(onArc(vx, vy, w, (1.5 * k) / 16)));
    brush.line(along(wanted), "--fail", 2.5, 1, [5, 4]);
    brush.line(along(twist), "--think", 3.5);
  },

  way(brush, numbers) {
    const points = [];
    for (let k = 0; k < numbers.length && !Number.isNaN(numbers[k]); k += 2) points.push([numbers[k], numbers[k + 1]]);
    brush.line(points, "--think", 2, 0.9, [6, 3]);
    if (numbers.length < 300) return;
    for (const point of points) brush.dot(point, "--think", 3);
  },
};

// The overlay of a trained agent: what its guard or its base makes of what it wanted, or it of what that asks for.
function guardOf({ guard, base, fill_bodies_scales: scales }) {
  if (guard) return { kind: "guard", title: "red, dashed: what it wants; violet: what its safety check leaves of it", numbers: guard };
  return base && { kind: "guard", title: base.guards ? "red, dashed: what it wants; violet: what ORCA, a rule that dodges, leaves of it" : "red, dashed: ORCA, a rule that dodges, alone; violet: as the network corrects it", numbers: scales };
}

// Beside the picture's own runs, in a memory of its own: what is drawn changes nothing of what is driven.
class Looks {
  constructor(drive) {
    this.drive = drive;
    this.replay = drive.replay;
    this.on = false;
    this.sides = [0, 1].map(() => ({ shadow: null, kernels: null })); // of the two panes
    this.button = button("show its thinking", () => this.turn(!this.on), { "aria-pressed": "false", class: "kept" });
    this.legend = el("p", { class: "hint", hidden: true });
    this.replay.scanButton.after(this.button);
    this.replay.words.append(this.legend);
    this.replay.under = (view, actor, pane) => this.draw(view, actor, this.sides[pane]);
  }

  async turn(on) {
    this.on = on;
    this.button.setAttribute("aria-pressed", on);
    if (on) for (const side of this.sides) side.kernels = side.kernels || await this.drive.kernels.twin();
    this.replay.refresh();
  }

  // The run that is looked at, where its policy has something to draw.
  run(actor) {
    const { drive } = this;
    const run = drive.runs.find((each) => each.actor === actor && each.asked.label !== KEYBOARD);
    if (!run) return null;
    const { conditions, label } = run.asked;
    const recipe = drive.kernels.tables.pilots[`${drive.task} ${conditions.robot} ${conditions.actuators} ${label}`];
    const look = recipe && (recipe.look || guardOf(recipe));
    return look ? { run, look } : null;
  }

  // The numbers of a moment; null while they are not there yet.
  at(side, view, run, look, step) {
    const { drive } = this;
    const { actor, asked } = run;
    const key = [actor.version, drive.scenes, JSON.stringify(asked.gains)].join(" ");
    let { shadow } = side;
    if (!shadow || shadow.run !== run || shadow.key !== key) shadow = this.begin(side, run, key);
    const fresh = look.kind === "field";
    const known = shadow.kept.get(step);
    if (known && !fresh) return known;
    if (shadow.step > step || (shadow.step === step && shadow.twist)) shadow = this.begin(side, run, key);
    const begun = performance.now();
    while (shadow.step < step) {
      if (performance.now() - begun > LOOKING) { this.later(); return null; }
      shadow.simulator.step(shadow.twist || shadow.pilot.act());
      shadow.twist = null;
      shadow.step += 1;
    }
    const { pose } = shadow.simulator;
    // of a scene that is just being changed: what is drawn would not be what was driven
    if (Math.abs(pose[0] - actor.x[step]) + Math.abs(pose[1] - actor.y[step]) > 1e-9) return null;
    const places = fresh ? this.places(view, look.places) : null;
    if (!shadow.simulator.alive[0]) return null; // it has arrived, and others have not
    const looked = { numbers: look.numbers || shadow.pilot.look(places), places, shape: look.shape, twist: null, solid: fresh ? solidsAt(drive.replay.world, step * DT) : null };
    if (["arcs", "guard"].includes(look.kind)) shadow.twist = shadow.pilot.act(); // the one that is driven
    looked.twist = shadow.simulator.crowd ? shadow.twist && shadow.twist[0] : shadow.twist;
    looked.wanted = shadow.pilot.wanted;
    if (shadow.kept.size > KEPT_LOOKS) shadow.kept.clear();
    shadow.kept.set(step, looked);
    return looked;
  }

  begin(side, run, key) {
    const { drive } = this;
    if (side.shadow) side.shadow.simulator.free();
    side.shadow = null;
    const { asked } = run;
    const simulator = new Simulator(side.kernels, drive.replay.world, asked.conditions);
    drive.again(simulator, asked);
    side.shadow = { run, key, simulator, pilot: pilotFor(simulator, asked.label, asked.gains), step: asked.from ? asked.step : 0, kept: new Map(), twist: null };
    return side.shadow;
  }

  // All over the picture, evenly.
  places(view, most) {
    const [cx, cy] = view.centre;
    const [width, height] = [view.width / view.pixels, view.height / view.pixels];
    const columns = Math.max(Math.floor(Math.sqrt((most * width) / height)), 1);
    const rows = Math.max(Math.floor(most / columns), 1);
    const places = new Float64Array(2 * most).fill(NaN);
    for (let k = 0; k < columns * rows; k++) {
      places[2 * k] = cx + ((k % columns) + 0.5 - columns / 2) * (width / columns);
      places[2 * k + 1] = cy + (Math.floor(k / columns) + 0.5 - rows / 2) * (height / rows);
    }
    return places;
  }

  later() {
    if (this.waits) return;
    this.waits = true;
    setTimeout(() => { this.waits = false; if (!this.replay.playing) this.replay.refresh(); }, 0);
  }

  draw(view, actor, side) {
    const { drive, replay } = this;
    const found = this.run(actor);
    if (side === this.sides[0]) this.tell(found);
    if (!this.on || !found || !side.kernels || !actor.x.length) return;
    const { run, look } = found;
    const step = Math.min(replay.step, actor.x.length - 1);
    if (run.asked.from && step < run.asked.step) return;
    let looked = null;
    try {
      looked = this.at(side, view, run, look, step);
    } catch (error) {
      this.turn(false);
      drive.result.textContent = `Its thinking cannot be drawn: ${error.message}.`;
    }
    if (!looked) return;
    const brush = new Brush(view.context, 1 / view.pixels, [actor.x[step], actor.y[step], actor.heading[step]], HULLS[actor.robot] || 0.25);
    LOOKS[look.kind](brush, looked.numbers, looked);
    view.context.globalAlpha = 1;
  }

  tell(found) {
    const { replay, replay: { other } } = this;
    const shown = [found, other && this.run(other)].filter(Boolean); // of either pane
    const told = [...new Set(shown.map(({ run, look }) => `${run.actor.label}: ${look.title}`))].join(". ");
    this.button.disabled = !shown.length; // nor has the hand any that could be drawn
    const hand = !told && replay.actors.length > 1 && replay.chosen && [KEYBOARD, FRIEND].includes(replay.chosen.policy);
    this.button.dataset.why = hand ? "choose a rival first" : "";
    this.button.title = told || (hand ? "A run by hand is chosen; choose a rival to see its thinking." : "of this one nothing can be drawn");
    this.legend.hidden = !(this.on && shown.length);
    this.legend.textContent = `What is drawn: ${told}`;
    this.legend.classList.toggle("long", told.length > 0.6 * LONG_LINE);
  }
}
