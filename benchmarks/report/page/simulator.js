// The robots of one world, stepped by the package's own kernels; among people too, who walk by theirs.

// The task of a world; undefined where the kernels know none of its kind.
const taskOf = ({ tables }, { kind }) => Object.keys(tables.tasks).find((task) => tables.tasks[task].kind === kind);
// Robots that the kernels know for a task, or for any where nobody can drive.
const robotsOf = ({ tables }, task) => Object.keys((tables.tasks[task] || Object.values(tables.tasks)[0]).robots);
// What a robot runs into besides the cells of a map; of a map that is too large for the page, its outline.
const solidsOf = (world) => [...(world.obstacles || []), ...((!world.grid && world.walls) || [])];
// Of each the fields of an OBSTACLE record, its patrol last.
const recordsOf = (world) => solidsOf(world).map((shape, k) => [...shape, (world.patrols || [])[k] || [0, 0, 0, 0, 0, 0]]);
const NOISE_BLOCK = 64;
const POSE_COLUMNS = 7;
const NEAREST = 10; // bodies that are kept of each
const BODY = 7; // numbers of a body that is seen
const SIGHT = 5; // m, within which bodies are seen
const GONE = 1e6; // m: where a body is that has left

// The page's own noise, for disturbed runs: Python draws others.
function normals(seed) {
  let state = (seed * 2654435761 + 0x9e3779b9) >>> 0 || 1;
  const uniform = () => {
    state ^= state << 13;
    state >>>= 0;
    state ^= state >>> 17;
    state ^= state << 5;
    state >>>= 0;
    return (state + 0.5) / 4294967296;
  };
  return { uniform, normal: () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform()) };
}

class Simulator {
  constructor(kernels, world, { robot, actuators, disturbance = "none", seed = 1 }) {
    this.kernels = kernels;
    this.world = world;
    this.task = taskOf(kernels, world);
    this.tables = kernels.tables.tasks[this.task];
    this.robot = robot;
    this.actuators = actuators;
    this.disturbance = kernels.tables.disturbances[disturbance];
    this.body = this.tables.robots[robot];
    this.random = normals(seed);
    this.begun = kernels.mark();
    this.constants = new Map();
    this.smooth = {};
    this.crowd = Boolean(world.walks); // whether there are others: robots, each with a goal of its own, and people
    this.team = 1 + (world.starts || []).length;
    this.alive = new Array(this.team).fill(true);
    this.ends = new Array(this.team).fill("");
    this.build(`${robot} ${actuators} ${disturbance}`);
    this.each = this.alive.map((_, row) => Object.assign(Object.create(this), { row })); // as the pilots of each see it
    kernels.users.push(this);
  }

  build(conditions) {
    const { kernels, tables, world, disturbance, team } = this;
    const memory = (array, Kind) => ({ at: kernels.put(new Uint8Array(new Kind(array).buffer)), shape: [array.length] });
    const room = (bytes, shape) => {
      const at = kernels.room(Math.max(bytes, 8));
      new Uint8Array(kernels.memory.buffer).fill(0, at, at + bytes);
      return { at, shape };
    };
    this.solids = recordsOf(world);
    const obstacles = this.solids.length;
    this.beams = tables.beams;
    this.rows = disturbance.noisy ? NOISE_BLOCK : 1;
    this.columns = POSE_COLUMNS + this.beams * (disturbance.drops ? 2 : 1) + (tables.tracks || 0);
    this.state = new Records(kernels, tables.state, team);
    this.course = new Records(kernels, tables.course, team);
    const field = (values, name) => this.field(values, name);
    const actions = this.body.axes.length;
    this.late = (kernels.tables.lates || {})[`${this.robot} ${this.actuators}`]; // of a base that answers late
    const columns = actions + (this.late ? this.late.requested : 0);
    this.arrays = {
      params: { at: kernels.put(kernels.blob(tables.params[conditions])), shape: [1] },
      states: this.state.array,
      courses: this.course.array,
      obstacles: { ...field(this.forAll(this.solids), "obstacle"), shape: [team, obstacles] },
      actions: room(8 * columns * team, [team, columns]),
      noise: room(8 * team * this.rows * this.columns, [team, this.rows, this.columns]),
      skip: room(team, [team]),
      shares: room(8, [0]),
      rows: memory(this.alive.map((_, row) => BigInt(row)), BigInt64Array),
      out: room(4 * team * this.body.size, [team, this.body.size]),
      numbers: room(8 * team * tables.numbers.length, [tables.numbers.length, team]),
      flags: room(team * tables.flags.length, [tables.flags.length, team]),
    };
    const shoved = disturbance.shove > 0 ? 2 : 0;
    const count = 1 + tables.draws + shoved;
    const draws = Array.from({ length: count * team }, (_, k) => (world.draws && k < Math.min(count, world.draws.length) ? world.draws[k] : k % count > tables.draws ? this.random.uniform() : 0.5));
    draws[0] = 0;
    this.arrays.draws = { ...memory(draws, Float64Array), shape: [team, count] };
    if (world.kind === "path") this.layPath();
    else this.layGoals(field, memory);
    if (this.crowd) this.layBodies(field, memory, room);
    this.asked = Array.from({ length: disturbance.delay }, () => this.alive.map(() => new Array(actions).fill(0)));
  }

  // Records of a kind, each given by its numbers in order.
  field(values, name) {
    const records = new Records(this.kernels, this.kernels.tables.records[name], values.length);
    const names = Object.keys(records.layout.fields);
    values.forEach((value, k) => names.forEach((each, j) => records.set(each, value[j], k)));
    return records.array;
  }

  // Where a constant of the tables lies, once for all robots.
  kept(blob, decoded = (bytes) => bytes) {
    if (!this.constants.has(blob)) this.constants.set(blob, this.kernels.put(decoded(this.kernels.blob(blob))));
    return this.constants.get(blob);
  }

  // A row a robot of what all have in common.
  forAll(rows) {
    return this.alive.flatMap(() => rows);
  }

  setParam(name, value) {
    const [offset, kind] = this.tables.sheet[name];
    new KINDS[kind](this.kernels.memory.buffer, this.arrays.params.at + offset, 1).fill(kind === "<i8" ? BigInt(value) : value);
  }

  // What a world keeps of its bodies: robots first, then people.
  layBodies(field, memory, room) {
    const { kernels, tables, world, arrays, team } = this;
    const people = world.walks.length;
    const count = team + people;
    const records = (name, length, shape) => ({ ...new Records(kernels, kernels.tables.records[name], length).array, shape });
    this.setParam("team", team);
    this.setParam("people", people);
    this.setParam("reach", Math.max(world.reach, SIGHT));
    arrays.walks = { ...field(world.walks, "walk"), shape: [1, people] };
    arrays.tracks = { ...memory((world.tracks || []).flat(), Float64Array), shape: [(world.tracks || []).length, 4] };
    arrays.near_places = records("place", 2 * count, [2, 1, count]);
    arrays.hulls = records("hull", count, [1, count]);
    arrays.near = room(8 * count * NEAREST, [1, count, NEAREST]);
    arrays.counts = room(8 * count, [1, count]);
    arrays.clocks = room(16, [1, 2]);
    arrays.walkers = records("walker", people, [1, people]);
    this.places = Object.assign(Object.create(Records.prototype), { kernels, layout: kernels.tables.records.place, count: 2 * count, at: arrays.near_places.at });
  }

  // Where the other bodies are: [x, y] of robots, then of people; far away who has left.
  get others() {
    if (!this.crowd) return [];
    const count = this.arrays.counts.shape[1];
    const now = Number(this.kernels.i64(this.arrays.clocks.at, 1)[0]) * count;
    return Array.from({ length: count - 1 }, (_, k) => (this.places.get("present", now + k + 1) ? [this.places.get("x", now + k + 1), this.places.get("y", now + k + 1)] : [GONE, GONE]));
  }

  layGoals(field, memory) {
    const { kernels, tables, world, course, arrays, solids, team } = this;
    const obstacles = solids.length;
    const points = (world.waypoints || []).map(([x, y]) => [x, y, 0]).concat([world.goal]);
    const starts = [world.start, ...(world.starts || [])];
    starts.forEach((start, row) => {
      for (const name of ["start_offset", "start_turn", "position_tolerance", "heading_tolerance", "waypoint_radius"]) course.set(name, world[name], row);
      course.set("start", start, row);
      course.set("num_goals", points.length, row);
      course.set("num_obstacles", obstacles, row);
    });
    arrays.goals = { ...memory([...points, ...(this.crowd ? world.goals : [])].flat(), Float64Array), shape: [team, points.length, 3] };
    arrays.fields = { ...field(this.forAll(solids), "obstacle"), shape: [team, obstacles] };
    this.setParam("moving", (world.patrols || []).some(([, , , , legTime]) => legTime > 0) ? 1 : 0);
    const { frame, cells } = world.grid || { frame: new Array(9).fill(0), cells: "" };
    const bytes = bytesOf(cells);
    arrays.cells = { at: bytes.length ? kernels.put(bytes) : kernels.room(8), shape: [bytes.length] };
    this.toldFrames = { ...field([frame], "frame"), shape: [1] };
    Object.keys(kernels.tables.records.frame.fields).forEach((name, k) => course.set(name, frame[k]));
    arrays.beams = { at: kernels.put(kernels.blob(tables.directions)), shape: [2, this.beams] };
  }

  layPath() {
    const { world, course, arrays } = this;
    const { ring, lap, vertices, runs } = this.courseOf(world.path, world.closed);
    Object.assign(arrays, { vertices, runs });
    const first = [...world.path[0], this.bearings([ring[1][1] - ring[0][1]], [ring[1][0] - ring[0][0]])[0]];
    course.set("finish", world.laps ? world.laps * lap : Infinity);
    course.set("per_metre", 1 / (Math.max(world.laps, 1) * lap));
    course.set("corridor", world.corridor);
    course.set("start", world.start || first);
    course.set("start_offset", world.start_offset);
    course.set("start_turn", world.start_turn);
  }

  // The records of a path, and its points with the first one again at the end of a closed one.
  courseOf(points, closed) {
    const { kernels } = this;
    const ring = closed ? [...points, points[0]] : points;
    const n = ring.length;
    const [dx, dy, length] = [new Float64Array(n - 1), new Float64Array(n - 1), new Float64Array(n - 1)];
    const s = new Float64Array(n);
    for (let k = 0; k + 1 < n; k++) {
      dx[k] = ring[k + 1][0] - ring[k][0];
      dy[k] = ring[k + 1][1] - ring[k][1];
      length[k] = Math.sqrt(dx[k] * dx[k] + dy[k] * dy[k]);
      s[k + 1] = s[k] + length[k];
    }
    const unit = (k) => [dx[Math.min(k, n - 2)] / length[Math.min(k, n - 2)], dy[Math.min(k, n - 2)] / length[Math.min(k, n - 2)]];
    const headings = this.bearings(ring.map((_, k) => unit(k)[1]), ring.map((_, k) => unit(k)[0]));
    const vertices = this.field(ring.map(([x, y], k) => [x, y, s[k], ...unit(k), headings[k]]), "vertex");
    const lap = s[n - 1];
    const even = lap / (n - 1);
    let off = 0;
    for (let k = 0; k < n; k++) off = Math.max(off, Math.abs(s[k] - (k === n - 1 ? lap : k * even)));
    const perMetre = off < (n === 2 ? lap : even) ? (n - 1) / lap : 0;
    const records = new Records(kernels, kernels.tables.records.run, 1);
    const run = { first: 0, segments: n - 1, closed: closed ? 1 : 0, length: lap, per_metre: perMetre };
    for (const [name, value] of Object.entries(run)) records.set(name, value);
    return { ring, lap, vertices, runs: records.array };
  }

  // The path as laws drive it, without its wiggles, and where on it a place of the path as it is lies: `smoothed` of the package.
  smoothed(endsOnly) {
    if (this.smooth[endsOnly]) return this.smooth[endsOnly];
    const { kernels, arrays, world: { closed } } = this;
    const { vertices } = arrays;
    const records = Object.assign(Object.create(Records.prototype), { kernels, layout: kernels.tables.records.vertex, at: vertices.at });
    const points = Array.from({ length: vertices.shape[0] }, (_, k) => ["x", "y", "s"].map((name) => records.get(name, k)));
    const put = (rows) => ({ at: kernels.put(new Uint8Array(new Float64Array(rows.flat()).buffer)), shape: [rows.length, 3] });
    const most = 64 + 16 * points.length;
    const mark = kernels.mark();
    const out = { at: kernels.room(24 * most), shape: [most, 3] };
    kernels.call("smooth_course", { points: put(points), closed: closed ? 1 : 0, ends_only: endsOnly ? 1 : 0, out });
    const count = kernels.f64(out.at, 1)[0];
    if (count >= most) throw new Error("the path has too many wiggles for the page");
    const rows = Array.from({ length: count }, (_, k) => Array.from(kernels.f64(out.at + 24 * (k + 1), 3)));
    kernels.release(mark);
    const column = (values) => ({ at: kernels.put(new Uint8Array(new Float64Array(values).buffer)), shape: [values.length] });
    const course = this.courseOf(rows.slice(0, closed ? -1 : undefined).map(([x, y]) => [x, y]), closed);
    const lap = points[points.length - 1][2];
    const rough = { at: kernels.put(new Uint8Array(BigInt64Array.of(course.lap === lap ? 0n : 1n).buffer)), shape: [1] };
    this.smooth[endsOnly] = { vertices: course.vertices, runs: course.runs, given: column(rows.map((row) => row[2])), laps: column([lap]), rough };
    return this.smooth[endsOnly];
  }

  bearings(y, x) {
    const { kernels } = this;
    const mark = kernels.mark();
    const put = (values) => ({ at: kernels.put(new Uint8Array(new Float64Array(values).buffer)), shape: [y.length] });
    const angles = put(y);
    kernels.call("fill_bearings", { y: put(y), x: put(x), angles });
    const found = Array.from(kernels.f64(angles.at, y.length));
    kernels.release(mark);
    return found;
  }

  fillNoise() {
    if (!this.disturbance.noisy) return;
    const noise = this.kernels.f64(this.arrays.noise.at, this.team * this.rows * this.columns);
    for (let k = 0; k < noise.length; k++) noise[k] = this.random.normal();
  }

  reset() {
    this.fillNoise();
    this.kernels.call(`${this.tables.rows}_reset`, this.arrays);
    return this.observe();
  }

  // Goes on where a recorded robot was: at its pose, with its twist, as far along its way as it had come.
  takeUp([x, y, heading], [vx, vy, yawRate], recorded, step) {
    const { state, world } = this;
    const set = (values) => { for (const [name, value] of Object.entries(values)) state.set(name, value); };
    set({ x, y, heading, odometry_x: x, odometry_y: y, odometry_heading: heading, steps: step - 1 });
    for (const part of ["", "command_", "wheel_", "measured_"]) set({ [`${part}vx`]: vx, [`${part}vy`]: vy, [`${part}yaw_rate`]: yawRate });
    if (world.kind === "path") {
      const [s, segment] = this.along(recorded, step);
      set({ arc_length: s, segment, measured_arc_length: s, measured_segment: segment });
    } else set({ waypoint: this.passed(recorded, step) });
    this.kernels.call(`${this.tables.rows}_step`, { phases: 4, thread: 0, ...this.arrays }); // judges where it is: no motion
    return this.observe();
  }

  // How far along the path a recorded robot had come: its nearest point, looked for a metre ahead of the last one.
  along(recorded, step) {
    const { world } = this;
    const ring = world.closed ? [...world.path, world.path[0]] : world.path;
    const lengths = ring.slice(1).map(([x, y], k) => Math.hypot(x - ring[k][0], y - ring[k][1]));
    let [segment, t, s] = [0, 0, 0];
    for (let k = 0; k <= step; k++) {
      let best = Infinity;
      let found = [segment, t, s];
      let [i, at] = [segment, s - t];
      while (at < s + 1) {
        const [ax, ay] = ring[i];
        const [ux, uy] = [(ring[i + 1][0] - ax) / lengths[i], (ring[i + 1][1] - ay) / lengths[i]];
        const near = Math.min(Math.max((recorded.x[k] - ax) * ux + (recorded.y[k] - ay) * uy, i === segment && at <= s ? s - at : 0), lengths[i]);
        const distance = Math.hypot(recorded.x[k] - ax - near * ux, recorded.y[k] - ay - near * uy);
        if (distance < best) [best, found] = [distance, [i, near, at + near]];
        at += lengths[i];
        i += 1;
        if (i === lengths.length) { if (!world.closed) break; i = 0; }
      }
      [segment, t, s] = found;
    }
    return [s, segment];
  }

  passed(recorded, step) {
    const { waypoints, waypoint_radius: radius } = this.world;
    let next = 0;
    for (let k = 0; k <= step; k++) while (next < waypoints.length && Math.hypot(recorded.x[k] - waypoints[next][0], recorded.y[k] - waypoints[next][1]) <= radius) next += 1;
    return next;
  }

  observe() {
    const { size: width, fields } = this.body;
    for (const one of this.each) {
      const flat = this.kernels.f32(this.arrays.out.at + 4 * width * one.row, width);
      one.seen = {};
      let k = 0;
      for (const [name, shape] of fields) {
        const size = shape.reduce((a, b) => a * b, 1);
        one.seen[name] = Float64Array.from(flat.subarray(k, k + size));
        k += size;
      }
    }
    this.seen = this.each[0].seen;
    return this.seen;
  }

  // A step of all: the twist of the robot, or of a team a list of them. A robot that has ended waits.
  step(twists) {
    const { kernels, arrays, state, disturbance, alive, ends, team } = this;
    const all = this.crowd ? twists : [twists];
    let asked = all.map((twist) => this.body.axes.map((axis) => (twist ? twist[axis] : 0)));
    if (disturbance.delay) {
      this.asked.push(asked);
      asked = this.asked.shift();
    }
    const columns = arrays.actions.shape[1];
    asked.forEach((action, row) => kernels.f64(arrays.actions.at + 8 * columns * row, action.length).set(action));
    if (disturbance.noisy && alive.some((is, row) => is && state.get("noise_row", row) >= NOISE_BLOCK)) {
      this.fillNoise();
      alive.forEach((_, row) => state.set("noise_row", 0, row));
    }
    new Uint8Array(kernels.memory.buffer, arrays.skip.at, team).set(alive.map((is) => (is ? 0 : 1)));
    kernels.call(`${this.tables.rows}_step`, { phases: 7, thread: 0, ...arrays });
    this.observe();
    const flags = new Uint8Array(kernels.memory.buffer, arrays.flags.at, team * this.tables.flags.length);
    const of = (row) => Object.fromEntries(this.tables.flags.map((name, k) => [name, flags[k * team + row] !== 0]));
    if (!this.crowd) return of(0);
    alive.forEach((is, row) => {
      const told = of(row);
      if (is && told.ended) [alive[row], ends[row]] = [false, told.success ? "success" : "collision"];
    });
    return { ended: !alive.includes(true), success: ends.every((each) => each === "success"), collision: ends.includes("collision") };
  }

  get pose() {
    return ["x", "y", "heading"].map((name) => this.state.get(name));
  }

  // What a policy may be told, by the name that recipes use.
  get briefing() {
    const { arrays, row = 0 } = this;
    const index = () => { this.zero = this.zero || { at: this.kernels.room(8), shape: [1] }; this.kernels.i64(this.zero.at, 1)[0] = 0n; return this.zero; };
    if (this.world.kind === "path") return { vertices: arrays.vertices, runs: arrays.runs, path_index: index() };
    const count = (value) => { const at = this.kernels.room(8); this.kernels.i64(at, 1)[0] = BigInt(value); return { at, shape: [1] }; };
    const obstacles = this.kernels.put(new Uint8Array(this.kernels.memory.buffer, arrays.obstacles.at, this.kernels.tables.records.obstacle.size * arrays.obstacles.shape[1]).slice());
    return { obstacles: { at: obstacles, shape: [1, arrays.obstacles.shape[1]] }, num_obstacles: count(arrays.obstacles.shape[1]),
      goals: { at: arrays.goals.at + 24 * arrays.goals.shape[1] * row, shape: [1, ...arrays.goals.shape.slice(1)] }, num_goals: count(arrays.goals.shape[1]),
      frames: this.toldFrames, cells: arrays.cells };
  }

  // Its room is given back once all that came after it is free too.
  free() {
    const { users } = this.kernels;
    this.freed = true;
    while (users.length && users[users.length - 1].freed) this.kernels.release(users.pop().begun);
  }
}
