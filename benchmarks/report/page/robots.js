// Robots of one's own: a data sheet of a differential drive, put into the records of the robot that it is like.

const SHEET = { // least and most, and what it is where the sheet does not say it
  "wheels.radius": [0.005, 1], "wheels.track": [0.02, 1.2], "hull.radius": [0.05, 0.6], rated_wheel_speed: [0.1, 1000], peak_wheel_speed: [0.1, 1000, null],
  acceleration: [0.01, 100, 1], yaw_acceleration: [0.01, 1000, 3], lag: [0, 2, 0.1], turn_speed: [0.01, 1000, Infinity],
};
const HARMLESS = ["name", "title", "drive", "wheels", "hull", "mass", "inertia", "friction", "driven_load", "sources", "sensors"];

const isSheet = (content) => typeof content === "object" && content !== null && ("wheels" in content || "hull" in content);

// The numbers of a sheet; an Error says what is wrong with it, or that the page cannot drive it.
function sheetOf(content, { sensors }) {
  if (content.drive !== "differential") throw new Error(`drive is ${JSON.stringify(content.drive)}; of a data sheet the page drives "differential" alone, wayfield evaluate --robot every one`);
  const found = { name: String(content.name || "mine").replace(/[^\w.-]/g, "_").slice(0, 40) || "mine" };
  for (const field of Object.keys(content)) {
    if (!HARMLESS.includes(field) && !(field in SHEET)) throw new Error(`field ${JSON.stringify(field)} is not known to the page, or is more than it can drive: wayfield evaluate --robot reads all`);
  }
  for (const [field, [low, high, missing]] of Object.entries(SHEET)) {
    const [part, name] = field.split(".");
    const value = name ? (content[part] || {})[name] : content[part];
    if (value === undefined && missing !== undefined) { found[name || part] = missing; continue; }
    if (typeof value !== "number" || !(value >= low && value <= high)) throw new Error(`${field} is ${JSON.stringify(value)}; it must be a number from ${low} to ${high}`);
    found[field === "hull.radius" ? "hull" : field === "wheels.radius" ? "radius" : name || part] = value;
  }
  for (const [field, allowed] of [["wheels", ["radius", "track"]], ["hull", ["radius"]]]) {
    for (const name of Object.keys(content[field])) if (!allowed.includes(name)) throw new Error(`${field}.${name} is more than the page can drive: wayfield evaluate --robot reads it`);
  }
  for (const name of ["range", "angle"]) {
    const value = (content.sensors || {})[name];
    if (value !== undefined && value !== sensors[name]) throw new Error(`sensors.${name} is ${JSON.stringify(value)}; the page's scan has ${sensors[name]}`);
  }
  if (found.peak_wheel_speed === null) found.peak_wheel_speed = found.rated_wheel_speed;
  if (found.peak_wheel_speed < found.rated_wheel_speed) throw new Error(`peak_wheel_speed is ${found.peak_wheel_speed}; it must be at least rated_wheel_speed, ${found.rated_wheel_speed}`);
  return found;
}

// What of a base a tier of actuators leaves, as the package says it.
function baseOf(sheet, tiers, tier) {
  const [rated, acceleration, yaw, lag] = tiers[tier];
  const [, nominal, nominalYaw, nominalLag] = tiers.lagged;
  return { limit: rated ? sheet.rated_wheel_speed : sheet.peak_wheel_speed, acceleration: acceleration === null ? Infinity : acceleration * (sheet.acceleration / nominal),
    yaw: yaw === null ? Infinity : yaw * (sheet.yaw_acceleration / nominalYaw), lag: lag * (sheet.lag / nominalLag) };
}

function lagFactors(lag, dt) {
  if (!lag) return [0, 0];
  const decay = Math.exp(-dt / lag);
  return [decay, ((1 - decay) * lag) / dt];
}

// Makes the kernels know a robot of a sheet: its records, and those of the laws that read nothing else of a base.
function addRobot(kernels, sheet) {
  const { tables } = kernels;
  const { plant, wheels, tiers, base } = tables.sheet;
  const { name } = sheet;
  const half = 0.5 * sheet.track;
  const lever = half / sheet.radius;
  const rim = 1 / sheet.radius;
  const matrix = [rim, 0, -lever, rim, 0, lever];
  const [along, across] = [rim / (rim * rim + rim * rim), lever / (lever * lever + lever * lever)];
  const forward = new Float64Array(3 * wheels);
  forward.set([along, along]);
  forward.set([-across, across], 2 * wheels);
  const put = (bytes) => { tables.blobs.push(bytes); return tables.blobs.length - 1; };
  const patched = (blob, changes) => {
    const bytes = (typeof tables.blobs[blob] === "string" ? bytesOf(tables.blobs[blob]) : tables.blobs[blob]).slice();
    const view = new DataView(bytes.buffer);
    for (const [at, values] of changes) [values].flat().forEach((value, k) => view.setFloat64(at + 8 * k, value, true));
    return put(bytes);
  };
  const top = [sheet.rated_wheel_speed / rim, Math.min(sheet.rated_wheel_speed / lever, sheet.turn_speed)];
  for (const [taskName, task] of Object.entries(tables.tasks)) {
    task.robots[name] = { ...task.robots[base], hull: sheet.hull, max_twist: top };
    task.ids[name] = task.ids[base];
    for (const key of Object.keys(task.params).filter((each) => each.startsWith(`${base} `))) {
      const [, tier, disturbance] = key.split(" ");
      const at = (field) => task.sheet[field][0];
      const now = baseOf(sheet, tiers, tier);
      const [decay, mean] = lagFactors(now.lag, DT);
      task.params[`${name} ${tier} ${disturbance}`] = patched(task.params[key], [
        [at("wheel_matrix"), matrix], [at("encoder_matrix"), matrix], [at("forward_matrix"), Array.from(forward)], [at("odometry_matrix"), Array.from(forward)],
        [at("wheel_speed_limit"), now.limit], [at("turn_speed"), sheet.turn_speed], [at("acceleration"), now.acceleration], [at("yaw_acceleration"), now.yaw],
        [at("deceleration"), now.acceleration], [at("yaw_deceleration"), now.yaw], [at("lag_decay"), decay], [at("lag_mean"), mean], [at("lags"), [now.lag, 0, now.lag]],
        [at("hull_radius"), sheet.hull], ...("max_speed" in task.sheet ? [[at("max_speed"), top[0]]] : [])]);
    }
    for (const key of Object.keys(tables.pilots).filter((each) => each.startsWith(`${taskName} ${base} `))) {
      const recipe = tables.pilots[key];
      if (!recipe.sheet) continue;
      const [, , tier, ...label] = key.split(" ");
      const now = baseOf(sheet, tiers, tier);
      const [decay, mean] = lagFactors(now.lag, DT);
      const kinds = { least: (number) => Math.min(number, now.acceleration), least_half: (number) => Math.min(number, 0.5 * now.acceleration), least_yaw: (number) => Math.min(number, now.yaw),
        share_yaw: (number) => number * now.yaw, late: () => now.lag + DT, most_yaw: () => top[1], decay: (step) => lagFactors(now.lag, step)[0], mean: (step) => lagFactors(now.lag, step)[1] };
      const at = (field) => recipe.sheet.plant + plant[field][0];
      const changes = [[at("hull_radius"), sheet.hull], [at("wheel_matrix"), matrix], [at("wheel_speed_limit"), now.limit], [at("turn_speed"), sheet.turn_speed], [at("acceleration"), now.acceleration],
        [at("yaw_acceleration"), now.yaw], [at("lag"), now.lag], [at("lag_decay"), decay], [at("lag_mean"), mean], ...recipe.sheet.fields.map(([place, kind, number]) => [place, kinds[kind](number)])];
      // a gain that such a field holds counts up to what this base can do
      const limits = Object.fromEntries(gainsOf(kernels, taskName, recipe).gains.flatMap((gain) => recipe.sheet.fields
        .filter(([place, kind]) => kind.startsWith("least") && gain.places.some(([, offset]) => offset === place)).map(([, kind]) => [gain.name, kinds[kind](Infinity)])));
      tables.pilots[`${taskName} ${name} ${tier} ${label.join(" ")}`] = { ...recipe, limits,
        arguments: recipe.arguments.map((each) => (each.name === "params" ? { ...each, blob: patched(each.blob, changes) } : each)) };
    }
  }
  HULLS[name] = sheet.hull;
}
