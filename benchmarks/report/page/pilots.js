// The decisions of policies: the same compiled laws, handed the same numbers.

function pilotFor(simulator, label, gains = {}) {
  const { kernels, task, robot, actuators } = simulator;
  const recipe = kernels.tables.pilots[`${task} ${robot} ${actuators} ${label}`];
  if (!recipe) return null;
  gains = { ...askedOf(kernels, task, recipe, simulator.world), ...gains };
  if (simulator.crowd) return new Everyone(simulator, recipe, gains);
  if (simulator.late) return new Predicted(simulator, new Law(simulator, recipe, gains));
  if (recipe.planner) return new Planned(simulator, recipe);
  return recipe.network ? new Network(simulator, recipe, gains) : new Law(simulator, recipe, gains);
}

// One policy drives all robots of a world, each by what it sees.
class Everyone {
  constructor(simulator, recipe, gains) {
    this.simulator = simulator;
    this.pilots = simulator.each.map((one) => (recipe.network ? new Network(one, recipe, gains) : new Law(one, recipe, gains)));
  }

  act() {
    return this.pilots.map((pilot, row) => (this.simulator.alive[row] ? pilot.act() : null));
  }

  look(places) {
    return this.pilots[0].look(places);
  }

  get wanted() {
    return this.pilots[0].wanted;
  }
}

// Policies that can drive here, by label.
function pilotsOf(kernels, task, robot, actuators) {
  const start = `${task} ${robot} ${actuators} `;
  return Object.keys(kernels.tables.pilots).filter((key) => key.startsWith(start)).map((key) => key.slice(start.length));
}

// The gains of a recipe that the page can change, each with its value and the ends of its slider, and the names of the others.
function gainsOf({ tables }, task, recipe, world = {}) {
  const sliders = recipe && recipe.make && tables.sliders[`${task} ${recipe.make.name}`];
  if (!sliders) return { gains: [], fixed: [] };
  const gains = sliders.gains.filter(({ name }) => name in recipe.gains).map((each) => {
    const asks = each.name === recipe.cruise && world.speed && (!recipe.network || (world.speed >= each.low && world.speed <= each.high));
    const value = asks ? world.speed : recipe.gains[each.name];
    return { ...each, value, low: Math.min(each.low, value), high: Math.max(each.high, value) };
  });
  return { gains, fixed: sliders.fixed };
}

// The gains by which a policy drives at the speed that its world asks for, as in the run that the world is of.
function askedOf(kernels, task, recipe, world) {
  const asked = gainsOf(kernels, task, recipe, world).gains.filter(({ name, value }) => name === recipe.cruise && value !== recipe.gains[name]);
  return Object.fromEntries(asked.map(({ name, value }) => [name, value]));
}

class Law {
  constructor(simulator, recipe, gains) {
    this.simulator = simulator;
    this.recipe = recipe;
    const { kernels } = simulator;
    this.course = recipe.smooth ? simulator.smoothed(recipe.smooth === "ends") : null;
    const briefing = { ...simulator.briefing, ...this.course };
    this.values = {};
    this.inputs = [];
    this.fresh = []; // zeros at every decision
    for (const each of recipe.arguments) {
      if (each.role === "number") this.values[each.name] = each.value;
      else if (each.role.startsWith("briefing.")) this.values[each.name] = briefing[each.role.slice(9)];
      else if (each.role.startsWith("seen.")) {
        const size = each.shape.reduce((a, b) => a * b, 1);
        const place = { at: kernels.room(8 * size), shape: each.shape, size };
        this.values[each.name] = place;
        this.inputs.push([each.role.slice(5), place]);
      } else if (each.role === "out") {
        const bytes = each.size * each.shape.reduce((a, b) => a * b, 1);
        this.values[each.name] = { at: kernels.put(new Uint8Array(bytes)), shape: each.shape }; // zeros, as Python begins with
      } else if (each.role === "fresh") {
        const bytes = each.size * each.shape.reduce((a, b) => a * b, 1);
        this.values[each.name] = { at: kernels.room(bytes), shape: each.shape };
        this.fresh.push([this.values[each.name].at, bytes]);
      } else this.values[each.name] = { at: kernels.put(kernels.blob(each.blob)), shape: each.shape };
    }
    for (const { name, whole, places } of gainsOf(kernels, simulator.task, recipe).gains) {
      if (!(name in gains)) continue;
      const number = Math.min(gains[name], (recipe.limits || {})[name] ?? Infinity); // what the actuators leave of it
      for (const [argument, offset] of places) {
        if (offset === null) this.values[argument] = number;
        else if (whole) kernels.i64(this.values[argument].at + offset, 1)[0] = BigInt(number);
        else kernels.f64(this.values[argument].at + offset, 1)[0] = number;
      }
    }
    const shared = recipe.sheet && recipe.sheet.fields.find(([, kind]) => kind === "share_yaw");
    if (shared && "share" in gains) {
      const place = recipe.sheet.plant + kernels.tables.sheet.plant.yaw_acceleration[0];
      const yaw = recipe.yaw ?? kernels.f64(this.values.params.at + place, 1)[0]; // of a base that brakes worse the plant has the less
      kernels.f64(this.values.params.at + shared[0], 1)[0] = gains.share * yaw;
    }
    if (recipe.rest) {
      const [offset, radius, share] = [recipe.rest[0], gains.stop_radius ?? recipe.rest[1], recipe.rest[2]];
      kernels.f64(this.values.memory.at + offset, 1)[0] = Math.min(radius, share * simulator.world.position_tolerance);
    }
  }

  // Hands the law what is observed.
  sense() {
    const { kernels, body, seen } = this.simulator;
    for (const [name, place] of this.inputs) {
      const numbers = kernels.f64(place.at, place.size);
      if (name === "twist3") {
        numbers.fill(0);
        body.axes.forEach((axis, k) => { numbers[axis] = seen.twist[k]; });
      } else numbers.set(seen[name]);
      if (name === "arc_length" && this.course) kernels.call("place_on_course", { "course.vertices": this.values["course.vertices"], "course.runs": this.values["course.runs"], "course.path_index": this.values["course.path_index"], given: this.course.given, laps: this.course.laps, arc_lengths: place });
    }
    for (const [at, bytes] of this.fresh) new Uint8Array(kernels.memory.buffer).fill(0, at, at + bytes);
  }

  // The numbers of its overlay at this moment; the law's memory is as it was afterwards.
  look(places) {
    const { kernels } = this.simulator;
    const { look } = this.recipe;
    const size = look.shape.reduce((a, b) => a * b, 1);
    this.looked = this.looked || { looked: { at: kernels.room(8 * size), shape: look.shape }, places: { at: kernels.room(16 * look.places), shape: [look.places, 2] } };
    const memories = this.recipe.arguments.filter(({ role }) => role === "memory").map(({ name, size: bytes, shape }) => {
      const { at } = this.values[name];
      const length = bytes * shape.reduce((a, b) => a * b, 1);
      return [at, new Uint8Array(kernels.memory.buffer, at, length).slice()];
    });
    this.sense();
    kernels.f64(this.looked.looked.at, size).fill(0);
    if (places) kernels.f64(this.looked.places.at, places.length).set(places);
    kernels.call(look.export, { ...this.values, ...this.looked });
    for (const [at, bytes] of memories) new Uint8Array(kernels.memory.buffer).set(bytes, at);
    return kernels.f64(this.looked.looked.at, size).slice();
  }

  // Decides; returns `count` numbers of what it fills.
  decide(count, { out, offset } = { out: "out", offset: 0 }) {
    const { kernels } = this.simulator;
    this.sense();
    kernels.call(this.recipe.export, this.values);
    return kernels.f64(this.values[out].at + offset, count);
  }

  act() {
    const { axes } = this.simulator.body;
    const out = this.decide({ unicycle: 2, planar: 3, axes: axes.length }[this.recipe.kind], this.recipe);
    if (this.recipe.kind === "axes") return [0, 1, 2].map((axis) => (axes.includes(axis) ? out[axes.indexOf(axis)] : 0));
    return this.recipe.kind === "unicycle" ? [out[0], 0, out[1]] : [out[0], out[1], out[2]];
  }
}

// Numbers of float32 from the two planes of bytes that hold their upper halves: `halves` of the package.
function joined(planes) {
  const count = planes.length / 2;
  const bits = new Uint32Array(count);
  for (let k = 0; k < count; k++) bits[k] = planes[k] * 16777216 + planes[count + k] * 65536;
  return new Uint8Array(bits.buffer);
}

// A trained agent: what its network sees is filled by the package's functions, and put together here as Python does.
class Network {
  constructor(simulator, recipe, gains) {
    this.simulator = simulator;
    this.recipe = recipe;
    this.speed = gains.speed ?? recipe.speed;
    const { kernels } = simulator;
    const doubles = (values) => ({ at: kernels.put(new Uint8Array(new Float64Array(values).buffer)), shape: [values.length] });
    const room = (bytes, shape) => {
      const at = kernels.room(Math.max(bytes, 8));
      new Uint8Array(kernels.memory.buffer).fill(0, at, at + bytes);
      return { at, shape };
    };
    this.doubles = doubles;
    this.room = room;
    this.inputs = room(4 * recipe.inputs, [1, recipe.inputs]);
    this.memory = room(4 * recipe.memory, [1, recipe.memory]);
    this.outputs = room(8, [1, 2]);
    this.scratch = room(8 * recipe.widest, [2, recipe.widest]);
    this.angles = room(8, [1]);
    this.speeds = doubles([this.speed]);
    if (recipe.pace) this.pace = { asked: this.speed, late: -recipe.pace.dt * this.speed, driven: 0 };
    this.sizes = { at: simulator.kept(recipe.sizes), shape: [recipe.layers] };
    this.numbers = { at: simulator.kept(recipe.numbers, joined), shape: [recipe.count] };
    this.fields = {};
    for (const [name, values] of Object.entries(simulator.seen)) this.fields[name] = doubles(Array.from(values));
    for (const name of ["fill_path", "fill_goal", "fill_trails", "fill_crumbs", "fill_moving", "fill_pose", "fill_bodies", "arrive"]) {
      if (recipe[`${name}_scales`]) this[name] = doubles(recipe[`${name}_scales`]);
    }
    if (recipe.arrive_scales) kernels.f64(this.arrive.at, 4)[3] = this.atMost(recipe.arrive_scales[3], "position_tolerance");
    if (recipe.guard) this.guard = doubles(recipe.guard);
    if (recipe.hold) {
      this.law = doubles(recipe.hold);
      this.matrix = { ...doubles(recipe.matrix.flat()), shape: [recipe.matrix.length, 3] };
      this.held = room(72, [1, 3, 3]);
    }
    if (recipe.shares) this.shares = doubles(recipe.shares);
    this.twist = room(24, [1, simulator.body.axes.length]);
    this.turned = room(24, [1, 3]);
    this.actions = room(16, [1, 2]);
    this.speedNow = room(8, [1]);
    this.angleNow = room(8, [1]);
    if (recipe.base) {
      this.eyes = Object.create(simulator); // sees the twist that the network sees
      this.want = new Law(this.eyes, recipe.base.want, {});
      this.avoid = new Law(this.eyes, recipe.base.avoid, {});
      if (gains.speed) for (const law of [this.want, this.avoid]) kernels.f64(law.values.params.at + law.recipe.speed, 1)[0] = gains.speed;
    }
    if (recipe.shield && simulator.team >= recipe.shield.from) this.shield = new Law(simulator, recipe.shield, {});
  }

  act() {
    const { recipe, memory, inputs, fields } = this;
    const { kernels, seen, body } = this.simulator;
    for (const [name, values] of Object.entries(seen)) kernels.f64(fields[name].at, values.length).set(values);
    if (recipe.any) kernels.f64(fields.ranges.at, seen.ranges.length).set(seen.ranges.map((range) => (range >= (1 - 1e-6) * recipe.any.own ? recipe.max_range : Math.min(range, recipe.max_range))));
    if (this.held) { // as a slower base would measure its twist: at the end of a control period, not in its mean
      const held = kernels.f64(this.held.at, 9);
      const twist = kernels.f64(fields.twist.at, body.axes.length);
      body.axes.forEach((axis, k) => { twist[k] += held[3 + axis] - held[6 + axis]; });
    }
    if (this.pace) this.keepPace();
    const part = (place, from, count) => ({ at: place.at + 4 * from, shape: [1, count] });
    const seenPart = part(inputs, 0, recipe.width);
    kernels.f64(this.angles.at, 1)[0] = 0;
    if (recipe.task === "path_following") {
      const k = fields.preview.shape[0] / 2;
      kernels.call("perception_fill_path", { errors: fields.cross_track_error, heading_errors: fields.heading_error, twists: { at: fields.twist.at, shape: [1, body.axes.length] },
        previews: { at: fields.preview.at, shape: [1, k, 2] }, speeds: this.speeds, scales: this.fill_path, out: seenPart });
    } else {
      kernels.call("perception_fill_goal", { goals: { at: fields.goal.at, shape: [1, 2] }, twists: { at: fields.twist.at, shape: [1, body.axes.length] },
        ranges: { at: fields.ranges.at, shape: [1, seen.ranges.length] }, speeds: this.speeds, scales: this.fill_goal, max_range: recipe.max_range,
        pool: recipe.pool, ahead: recipe.ahead ? 1 : 0, angles: this.angles, out: part(inputs, 0, recipe.width - (recipe.posed || 0) - (recipe.bodied || 0)) });
    }
    if (recipe.any) this.inHulls();
    if (recipe.bodied) {
      kernels.call("perception_fill_bodies", { bodies: { at: fields.bodies.at, shape: [1, seen.bodies.length / BODY, BODY] }, angles: this.angles,
        scales: this.fill_bodies, count: recipe.bodies, fronted: recipe.fronted ? 1 : 0, out: part(inputs, recipe.width - recipe.bodied, recipe.bodied) });
    }
    if (recipe.posed) {
      kernels.call("perception_fill_pose", { goals: { at: fields.goal.at, shape: [1, 2] }, turns: fields.goal_heading_error, angles: this.angles,
        scales: this.fill_pose, out: part(inputs, recipe.width - recipe.posed, recipe.posed) });
    }
    const acted = 2 * recipe.previous;
    let at = recipe.width;
    const kept = kernels.f32(memory.at, recipe.memory);
    kernels.f32(inputs.at + 4 * at, acted).set(kept.subarray(0, acted));
    at += acted;
    let first = acted; // of the memory
    const poses = { at: fields.pose.at, shape: [1, 3] };
    if (recipe.trails) {
      const whole = kernels.tables.orders.perception_fill_trails.includes("at");
      kernels.call("perception_fill_trails", { poses, angles: this.angles, shares: this.shares, scales: this.fill_trails, first, memory, at,
        begun: { at: memory.at + 4 * first, shape: [1] }, trails: { at: memory.at + 4 * (first + 1), shape: [1, recipe.trails, 2] },
        out: whole ? inputs : part(inputs, at, 2 * recipe.trails) });
      at += 2 * recipe.trails;
      first += 1 + 2 * recipe.trails;
    }
    if (recipe.crumbed) {
      const column = (k) => ({ at: memory.at + 4 * (first + k), shape: [1] });
      kernels.call("perception_fill_crumbs", { poses, goals: { at: fields.goal.at, shape: [1, 2] }, angles: this.angles, scales: this.fill_crumbs,
        count: recipe.crumbs, first, memory, out: part(inputs, at, recipe.crumbed),
        "crumbs.dropped": column(0), "crumbs.least": column(1), "crumbs.distance": column(2), "crumbs.waited": column(3),
        "crumbs.places": { at: memory.at + 4 * (first + 4), shape: [1, recipe.crumbs, 2] } });
      at += recipe.crumbed;
    }
    if (recipe.crumbs) first += 4 + 2 * recipe.crumbs;
    if (recipe.moved) {
      const beams = recipe.moved * recipe.pool / 2;
      const scan = (k) => ({ at: memory.at + 4 * (first + 2 + 2 * k * beams), shape: [1, beams, 2] });
      kernels.call("perception_fill_moving", { poses, ranges: { at: fields.ranges.at, shape: [1, seen.ranges.length] }, angles: this.angles,
        scales: this.fill_moving, max_range: recipe.max_range, pool: recipe.pool, "sights.ages": { at: memory.at + 4 * first, shape: [1, 2] },
        "sights.older": scan(0), "sights.newer": scan(1), out: part(inputs, at, recipe.moved) });
      at += recipe.moved;
      first += 2 + 4 * beams;
    }
    const { frames, stride, width } = recipe;
    for (let k = 1; k < frames; k++) {
      const old = first + (k * stride - 1) * width;
      kernels.f32(inputs.at + 4 * at, width).set(kernels.f32(memory.at + 4 * old, width));
      at += width;
    }
    kernels.f32(inputs.at + 4 * at, recipe.limits.length).set(recipe.limits);
    const asked = recipe.base && this.asked();
    if (asked) kernels.f32(inputs.at + 4 * (at + recipe.limits.length), 2).set(this.likeliest(asked));
    kernels.call("agent_forward", { inputs, sizes: this.sizes, numbers: this.numbers, rectified: recipe.rectified ? 1 : 0, scratch: this.scratch, outputs: this.outputs });
    const actions = Array.from(kernels.f32(this.outputs.at, 2), (value) => Math.min(Math.max(value, -1), 1));
    if (acted) {
      const now = kernels.f32(memory.at, recipe.memory);
      now.copyWithin(2, 0, acted - 2);
      now.set(actions, 0);
    }
    if (frames > 1) {
      const now = kernels.f32(memory.at, recipe.memory);
      now.copyWithin(first + width, first, recipe.memory - width);
      now.set(kernels.f32(inputs.at, width), first);
    }
    if (asked) return this.ended(this.added(asked, actions));
    this.wanted = this.meant(actions); // before the guard, for its overlay
    return this.ended(this.wanted);
  }

  // `RobotFeatures.observe`: the nearness of the ways ahead, s / (s + d), becomes w / (w + d), in single precision.
  inHulls() {
    const { recipe: { width, any: { way, range, count } }, inputs, simulator: { kernels } } = this;
    const ahead = kernels.f32(inputs.at + 4 * (width - count), count);
    const round = Math.fround;
    ahead.forEach((each, k) => {
      const near = round(round(way) * each);
      ahead[k] = near / round(near + round(round(range) * round(1 - each)));
    });
  }

  // The goal is a point that moves on with the robot: how long it has come no nearer is not counted.
  led(distance) {
    const { recipe, memory } = this;
    if (!recipe.crumbs) return;
    const first = 2 * recipe.previous + (recipe.trails ? 1 + 2 * recipe.trails : 0);
    this.simulator.kernels.f32(memory.at + 4 * (first + 1), 3).set([distance, distance, 0]);
  }

  // `kept_pace`, of one robot: what it is late by is made up.
  keepPace() {
    const { pace, recipe: { pace: { time, most, dt } }, simulator: { kernels, body, seen } } = this;
    const driven = Math.sqrt(Array.from(seen.twist).slice(0, body.axes.length - 1).reduce((sum, v) => sum + v * v, 0));
    pace.late += dt * (pace.asked - 0.5 * (driven + pace.driven));
    pace.driven = driven;
    this.speed = Math.min(Math.max(pace.asked + pace.late / time, 0.5 * pace.asked), Math.max(pace.asked, most));
    kernels.f64(this.speeds.at, 1)[0] = this.speed;
  }

  // What the base asks for: the velocity that it wants, or the twist that it drives by that.
  asked() {
    const { kernels, seen, body } = this.simulator;
    this.eyes.seen = { ...seen, twist: kernels.f64(this.fields.twist.at, body.axes.length).slice() };
    const wanted = this.want.decide(2);
    return this.recipe.base.guards ? Array.from(wanted) : this.clear(wanted);
  }

  // The twist of the velocity nearest to a wanted one that keeps clear.
  clear(wanted) {
    const { kernels, body } = this.simulator;
    kernels.f64(this.avoid.values.wanted.at, 2).set(wanted);
    return Array.from(this.avoid.decide(body.axes.length));
  }

  // A planar velocity, turned by an angle.
  turning([x, y], speed, angle) {
    const { kernels } = this.simulator;
    kernels.f64(this.speedNow.at, 1)[0] = speed;
    kernels.f64(this.angleNow.at, 1)[0] = angle;
    kernels.f64(this.actions.at, 2).set([x, y]);
    kernels.f64(this.turned.at, 3).fill(0);
    kernels.call("perception_turn", { actions: this.actions, speeds: this.speedNow, angles: this.angleNow, out: this.turned });
    return Array.from(kernels.f64(this.turned.at, 3));
  }

  get angle() {
    return this.simulator.kernels.f64(this.angles.at, 1)[0];
  }

  // `Actions.of_twists`, of one robot.
  likeliest([x, y]) {
    const { speed } = this;
    return this.turning([x / speed, y / speed], 1, -this.angle).slice(0, 2).map((value) => Math.min(Math.max(value, -1), 1));
  }

  // `Actions.wished` and what keeps that clear, or `Actions.added`, of one robot.
  added(asked, [a, b]) {
    const { speed, recipe: { base: { reach, guards } } } = this;
    const { axes } = this.simulator.body;
    const more = this.turning([reach * a, reach * b], speed, this.angle);
    const [x, y] = [asked[0] + more[0], asked[1] + more[1]];
    const most = guards ? speed : Math.max(speed, Math.sqrt(asked[0] * asked[0] + asked[1] * asked[1]));
    const factor = most / Math.max(Math.sqrt(x * x + y * y), most);
    const twist = [x * factor, y * factor, ...asked.slice(2)];
    this.wanted = guards ? [...twist, 0] : asked;
    const driven = guards ? this.clear(twist) : twist;
    return [0, 1, 2].map((axis) => (axes.includes(axis) ? driven[axes.indexOf(axis)] : 0));
  }

  // `Actions.twists`, of one robot.
  meant([a, b]) {
    const { recipe } = this;
    if (recipe.kind === "unicycle") return [this.speed * (0.5 * (1 + recipe.reverse) * (a + 1) - recipe.reverse), 0, recipe.yaw_rate * b];
    return this.turning([a, b], this.speed / Math.max(Math.sqrt(a * a + b * b), 1), this.angle);
  }

  // `rest_radius`: an agent's own, m or rad, or less where the goal asks.
  atMost(own, tolerance) {
    return Math.min(own, this.recipe.near_enough * this.simulator.world[tolerance]);
  }

  // Whether the robot is where it is to rest: `DockFeatures.arrived`.
  rests() {
    const { goal: [x, y], goal_heading_error: [turn], waypoints_left: [left] } = this.simulator.seen;
    const rest = this.atMost(this.recipe.rest, "position_tolerance");
    return x * x + y * y < rest * rest && left < 0.5 && Math.abs(turn) < this.atMost(this.recipe.rest_turn, "heading_tolerance");
  }

  // What stands around the network in `Agent.act`: `GoalFeatures.arrived` and `guarded`, `hold`, and the shield.
  ended(twist) {
    const { recipe, fields, shield } = this;
    const { kernels, body, seen } = this.simulator;
    if (!recipe.guard && !recipe.arrive_scales && !recipe.hold && !shield) return twist;
    const count = body.axes.length;
    kernels.f64(this.twist.at, count).set(body.axes.map((axis) => twist[axis]));
    if (recipe.arrive_scales) {
      kernels.call("perception_arrive", { goals: { at: fields.goal.at, shape: [1, 2] }, turns: fields.goal_heading_error,
        waypoints_left: fields.waypoints_left, scales: this.arrive, twists: this.twist });
    }
    if (recipe.guard) {
      kernels.call("perception_guard", { ranges: { at: fields.ranges.at, shape: [1, seen.ranges.length] },
        yaw_rates: { at: fields.twist.at + 8 * (count - 1), shape: [1] }, law: this.guard, twists: this.twist });
    }
    if (recipe.posed && this.rests()) kernels.f64(this.twist.at, count).fill(0);
    if (recipe.hold) kernels.call("perception_hold", { law: this.law, matrix: this.matrix, held: this.held, twists: this.twist });
    const found = [0, 0, 0];
    body.axes.forEach((axis, k) => { found[axis] = kernels.f64(this.twist.at, count)[k]; });
    if (recipe.hold) body.axes.forEach((axis) => { kernels.f64(this.held.at, 9)[6 + axis] = found[axis]; });
    if (!shield) return found;
    kernels.f64(shield.values.twists.at, 3).set(found);
    return Array.from(shield.decide(3, { out: "twists", offset: 0 }));
  }
}

// A planner above an agent: `Hybrid` of the package, and `AnyRobot`, whose planner drives by itself where the agent stands.
class Planned {
  constructor(simulator, recipe) {
    Object.assign(this, { simulator, recipe });
    const { alone } = recipe;
    this.planner = new Law(simulator, { ...recipe.planner, look: recipe.look }, {});
    this.eyes = Object.create(simulator); // sees a point of the way in place of the goal
    this.agent = new Network(this.eyes, recipe, {});
    this.goal = this.agent.doubles([0, 0]);
    this.flag = this.agent.room(8, [1]);
    if (alone) Object.assign(this, { behind: new Law(simulator, alone.behind, {}), least: Infinity, stood: 0, approached: 0 });
  }

  look(places) {
    return this.planner.look(places);
  }

  act() {
    const { planner, agent, recipe, simulator: { kernels, seen, body } } = this;
    const { memory, "seen.poses": poses } = planner.values;
    const own = Array.from(planner.decide(3, recipe.planner));
    kernels.f64(this.goal.at, 2).set(seen.goal);
    new Uint8Array(kernels.memory.buffer)[this.flag.at] = 0;
    kernels.call("hybrid_lead", { memory, poses, ahead: recipe.lead, goals: { at: this.goal.at, shape: [1, 2] }, led: this.flag });
    const led = new Uint8Array(kernels.memory.buffer)[this.flag.at] !== 0;
    const [x, y] = kernels.f64(this.goal.at, 2);
    if (led) agent.led(Math.sqrt(x * x + y * y));
    this.eyes.seen = { ...seen, goal: Float64Array.of(x, y), waypoints_left: led ? seen.waypoints_left.map((left) => Math.max(left, 1)) : seen.waypoints_left };
    const shield = recipe.alone && this.bytes(agent.shield).slice();
    let twist = agent.act();
    if (recipe.alone && this.byItself()) twist = this.byPlanner(own, shield);
    const command = kernels.f64(memory.at + recipe.planner.offset, 3);
    for (const axis of body.axes) command[axis] = twist[axis];
    return twist;
  }

  bytes({ recipe, values: { memory } }) {
    return new Uint8Array(this.simulator.kernels.memory.buffer, memory.at, recipe.arguments.find(({ name }) => name === "memory").size);
  }

  // The twist of the planner, behind a shield of its own that remembers what the agent's does.
  byPlanner(own, before) {
    const { simulator: { kernels, body }, behind, agent } = this;
    this.bytes(behind).set(before);
    kernels.f64(behind.values.twists.at, 3).set([0, 1, 2].map((axis) => (body.axes.includes(axis) ? own[axis] : 0)));
    const twist = Array.from(behind.decide(3, { out: "twists", offset: 0 }));
    this.bytes(agent.shield).set(this.bytes(behind));
    return twist;
  }

  // `AnyRobot._by_planner`, of one robot.
  byItself() {
    const { simulator: { kernels, seen }, planner: { values }, recipe: { alone } } = this;
    const { at } = values.memory;
    const { fields } = alone;
    kernels.call("stopping_find_approached", { ...values, poses: values["seen.poses"], ages: { at: at + fields.older_age[0], shape: [1] }, radius: alone.radius, approached: this.flag });
    this.approached = new Uint8Array(kernels.memory.buffer)[this.flag.at] ? this.approached + 1 : 0;
    const number = ([offset, kind], k = 0) => Number(new KINDS[kind](kernels.memory.buffer, at + offset, k + 1)[k]);
    const last = Math.max(number(fields.num_points) - 1, 0);
    const [x, y] = seen.goal;
    const left = last ? number(fields.arc, last) - number(fields.arc, number(fields.segment)) : Math.sqrt(x * x + y * y);
    const made = left < this.least - alone.way;
    if (made) this.least = left;
    const begins = (made && this.stood <= alone.patience) || this.approached >= alone.approached;
    this.stood = begins ? 0 : this.stood + alone.dt;
    return this.stood > alone.patience;
  }
}
