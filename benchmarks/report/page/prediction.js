// Bases that answer late: a law decides from the state that its command will meet, `forward_prediction` of the package.

class Predicted {
  constructor(simulator, law) {
    this.simulator = simulator;
    this.law = law;
    const { kernels, late } = simulator;
    this.own = simulator.tables.late;
    const records = kernels.tables.records;
    this.model = new Records(kernels, records.late_model, 1);
    for (const [name, value] of Object.entries(late.model)) if (name in records.late_model.fields) this.model.set(name, value);
    this.state = new Records(kernels, records.late_state, 1);
    const room = (...shape) => {
      const size = shape.reduce((a, b) => a * b, 1);
      const at = kernels.room(8 * Math.max(size, 1));
      kernels.f64(at, size).fill(0);
      return { at, shape, size };
    };
    const { twist, ranges, preview } = simulator.seen;
    this.axes = simulator.body.axes.slice(0, twist.length);
    Object.assign(this, { sent: room(1, late.requested + 3), scratch: room(1, late.requested + 3), twists: room(1, 3), steps: room(1, 3), pose: room(1, 3), goal: room(1, 2), turn: room(1) });
    if (preview) Object.assign(this, { arc: room(1), error: room(1), preview: room(1, preview.length / 2, 2) });
    if (ranges && ranges.length > 1) Object.assign(this, { beams: { at: kernels.put(kernels.blob(this.own.beams)), shape: [ranges.length, 2] }, scan: room(1, ranges.length), ranges: room(1, ranges.length) });
    this.briefing = preview ? simulator.briefing : null;
  }

  numbers({ at, size }) {
    return this.simulator.kernels.f64(at, size);
  }

  whole(values) {
    const twists = this.numbers(this.twists);
    twists.fill(0);
    this.axes.forEach((axis, k) => { twists[axis] = values[k]; });
    return twists;
  }

  // What will be observed when the next command acts.
  observed(seen) {
    const { kernels } = this.simulator;
    const moved = Object.fromEntries(Object.entries(seen).map(([name, values]) => [name, values.slice()]));
    this.whole(seen.twist);
    const [model, states] = [this.model.array, this.state.array];
    kernels.call("late_look_ahead", { model, states, sent: this.sent, scratch: this.scratch, twists: this.twists, steps: this.steps });
    this.axes.forEach((axis, k) => { moved.twist[k] = this.numbers(this.twists)[axis]; });
    this.numbers(this.pose).set(seen.pose);
    kernels.call("late_move", { steps: this.steps, poses: this.pose });
    moved.pose.set(this.numbers(this.pose));
    if (this.preview) {
      const fields = { arc: "arc_length", error: "cross_track_error", turn: "heading_error", preview: "preview" };
      for (const [name, field] of Object.entries(fields)) this.numbers(this[name]).set(seen[field]);
      kernels.call("late_follow", { "course.vertices": this.briefing.vertices, "course.runs": this.briefing.runs, "course.path_index": this.briefing.path_index, spacing: this.own.spacing,
        poses: this.pose, arc_lengths: this.arc, errors: this.error, heading_errors: this.turn, preview: this.preview });
      for (const [name, field] of Object.entries(fields)) moved[field].set(this.numbers(this[name]));
      return moved;
    }
    this.numbers(this.goal).set(seen.goal);
    this.numbers(this.turn).set(seen.goal_heading_error);
    kernels.call("late_view", { steps: this.steps, goals: this.goal, turns: this.turn });
    moved.goal.set(this.numbers(this.goal));
    moved.goal_heading_error.set(this.numbers(this.turn));
    if (this.scan) {
      this.numbers(this.scan).set(seen.ranges);
      const { first, step, closed, most } = this.own;
      kernels.call("late_rescan", { beams: this.beams, first, step, closed, most, joined: this.simulator.late.joined, steps: this.steps, scan: this.scan, out: this.ranges });
      moved.ranges.set(this.numbers(this.ranges));
    }
    return moved;
  }

  // Calls the law with what it will observe.
  with(call) {
    const { simulator } = this;
    const { seen } = simulator;
    simulator.seen = this.observed(seen);
    try {
      return call();
    } finally {
      simulator.seen = seen;
    }
  }

  act() {
    const { kernels } = this.simulator;
    const twist = this.with(() => this.law.act());
    const [model, states] = [this.model.array, this.state.array];
    this.numbers(this.twists).set(twist);
    kernels.call("late_compensate", { model, states, twists: this.twists });
    const sent = Array.from(this.numbers(this.twists));
    kernels.call("late_advance", { model, states, sent: this.sent, twists: this.twists });
    return sent;
  }

  look(places) {
    const { kernels } = this.simulator;
    const bytes = () => new Uint8Array(kernels.memory.buffer, this.state.at, this.state.layout.size);
    const before = bytes().slice();
    const looked = this.with(() => this.law.look(places));
    bytes().set(before);
    return looked;
  }
}
