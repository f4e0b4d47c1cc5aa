// Robots of one's own: a data sheet of a differential drive, put into the records of the robot that it is like.

const SHEET = { // least and most, and what it is where the sheet does not say it
  "wheels.radius": [0.005, 1], "wheels.track": [0.02, 1.2], "wheels.effective_track": [0.02, 5, null], "hull.radius": [0.05, 0.6], rated_wheel_speed: [0.1, 1000], peak_wheel_speed: [0.1, 1000, null],
  acceleration: [0.01, 100, 1], yaw_acceleration: [0.01, 1000, 3], turn_speed: [0.01, 1000, Infinity],
};
const OF_AXES = { // of the speed ahead and the yaw rate: least and most
  lag: [0, 2], delay: [0, 1], gain: [0.1, 10], decelerations: [0.01, 1000],
};
const WORDS = { saturation: ["twist", "wheels"], response: ["stepped", "continuous"] };
const HARMLESS = ["name", "title", "drive", "wheels", "hull", "mass", "inertia", "friction", "driven_load", "sources", "sensors"];

// The numbers of a sheet; an Error says what is wrong with it, or that the page cannot drive it.
function sheetOf(content, { sensors }) {
  if (content.drive !== "differential") throw new Error(`drive is ${JSON.stringify(content.drive)}; of a data sheet the page drives "differential" alone, wayfield evaluate --robot every one`);
  const found = { name: String(content.name || "mine").replace(/[^\w.-]/g, "_").slice(0, 40) || "mine" };
  for (const field of Object.keys(content)) {
    if (![HARMLESS, ...[SHEET, OF_AXES, WORDS].map(Object.keys)].flat().includes(field)) throw new Error(`field ${JSON.stringify(field)} is not known to the page, or is more than it can drive: wayfield evaluate --robot reads all`);
  }
  for (const [field, [low, high, missing]] of Object.entries(SHEET)) {
    const [part, name] = field.split(".");
    const value = name ? (content[part] || {})[name] : content[part];
    if (value === undefined && missing !== undefined) { found[name || part] = missing; continue; }
    if (typeof value !== "number" || !(value >= low && value <= high)) throw new Error(`${field} is ${JSON.stringify(value)}; it must be a number from ${low} to ${high}`);
    found[field === "hull.radius" ? "hull" : field === "wheels.radius" ? "radius" : name || part] = value;
  }
  for (const [field, [low, high]] of Object.entries(OF_AXES)) {
    const value = content[field];
    if (value === undefined) continue;
    const pair = field === "lag" && typeof value === "number" ? [value, value] : value;
    if (!Array.isArray(pair) || pair.length !== 2 || !pair.every((each) => typeof each === "number" && each >= low && each <= high)) throw new Error(`${field} is ${JSON.stringify(value)}; it must be ${field === "lag" ? "a number or " : ""}two numbers from ${low} to ${high}, of the speed ahead and the yaw rate`);
    found[field] = pair;
  }
  for (const [field, words] of Object.entries(WORDS)) {
    if (content[field] !== undefined && !words.includes(content[field])) throw new Error(`${field} is ${JSON.stringify(content[field])}; it must be ${words.map((each) => JSON.stringify(each)).join(" or ")}`);
    found[field] = content[field] || words[0];
  }
  found.responds = Boolean(found.delay || found.gain || found.decelerations || found.saturation !== "twist" || found.response !== "stepped" || Array.isArray(content.lag));
  found.lag = found.lag || [0.1, 0.1];
  for (const [field, allowed] of [["wheels", ["radius", "track", "effective_track"]], ["hull", ["radius"]]]) {
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
  const lags = sheet.lag.map((each) => lag * (each / nominalLag));
  const found = { limit: rated ? sheet.rated_wheel_speed : sheet.peak_wheel_speed, acceleration: acceleration === null ? Infinity : acceleration * (sheet.acceleration / nominal),
    yaw: yaw === null ? Infinity : yaw * (sheet.yaw_acceleration / nominalYaw), lag: Math.max(...lags), late: null };
  found.surely = [found.acceleration, found.yaw];
  if (!sheet.responds || !rated) return found;
  const [braking, yawBraking] = sheet.decelerations || [sheet.acceleration, sheet.yaw_acceleration];
  const [ahead, turn] = sheet.delay || [0, 0];
  const [gain, yawGain] = sheet.gain || [1, 1];
  found.late = { continuous: sheet.response === "continuous", wheels: sheet.saturation === "wheels", delays: [ahead, 0, turn], gains: [gain, 1, yawGain], lags: [lags[0], 0, lags[1]],
    deceleration: found.acceleration * (braking / sheet.acceleration), yawDeceleration: found.yaw * (yawBraking / sheet.yaw_acceleration) };
  found.surely = [Math.min(found.acceleration, found.late.deceleration), Math.min(found.yaw, found.late.yawDeceleration)];
  return found;
}

function lagFactors(lag, dt) {
  if (!lag) return [0, 0];
  const decay = Math.exp(-dt / lag);
  return [decay, ((1 - decay) * lag) / dt];
}

// A delay of each axis in whole control periods and the rest, s: `delay_periods` of the package.
function delayPeriods(late) {
  return late.delays.map((delay) => {
    const ratio = delay / DT;
    const nearest = Math.abs(ratio % 1) === 0.5 ? 2 * Math.round(ratio / 2) : Math.round(ratio);
    if (!late.continuous || Math.abs(delay - nearest * DT) < 1e-9) return [nearest, 0];
    const periods = Math.floor(ratio);
    return [periods, delay - periods * DT];
  });
}

// What records say of how a base answers: `motor_numbers` of the package.
function answers({ acceleration, yaw, lag, late }) {
  const delays = late ? delayPeriods(late) : [0, 0, 0].map(() => [0, 0]);
  const flag = (is) => BigInt(late && is ? 1 : 0);
  return { acceleration, yaw_acceleration: yaw, responds: flag(true), continuous: flag(late && late.continuous), wheel_saturation: flag(late && late.wheels),
    delay_periods: delays.map(([periods]) => BigInt(periods)), delay_rest: delays.map(([, rest]) => rest), gains: late ? late.gains : [1, 1, 1], lags: late ? late.lags : [lag, lag, lag],
    deceleration: late ? late.deceleration : acceleration, yaw_deceleration: late ? late.yawDeceleration : yaw };
}

// What predicts the state that a command will meet is made from: its model, and how many numbers of what was sent count.
function lateTable(now, wheels) {
  const delays = delayPeriods(now.late);
  const [periods, rest] = delays.reduce((most, each) => (each[0] > most[0] || (each[0] === most[0] && each[1] > most[1]) ? each : most));
  const requested = 3 * Math.max(...delays.map(([whole, part]) => whole + (part ? 2 : 1)));
  return { requested, model: { ...wheels, ...answers(now), dt: DT, wheel_speed_limit: now.limit, requests: 0n, periods: BigInt(periods), rest } };
}

// Makes the kernels know a robot of a sheet: its records, and those of the laws that read nothing else of a base.
function addRobot(kernels, sheet) {
  const { tables } = kernels;
  const { plant, wheels, tiers, base } = tables.sheet;
  const { name } = sheet;
  const half = 0.5 * (sheet.effective_track || sheet.track); // as it turns
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
    for (const [at, values] of changes) [values].flat().forEach((value, k) => (typeof value === "bigint" ? view.setBigInt64(at + 8 * k, value, true) : view.setFloat64(at + 8 * k, value, true)));
    return put(bytes);
  };
  tables.lates = tables.lates || {}; // of bases that answer late, by robot and tier
  for (const tier of Object.keys(tiers)) {
    const now = baseOf(sheet, tiers, tier);
    const motors = { num_wheels: 2n, wheel_matrix: matrix, forward_matrix: Array.from(forward), turn_speed: sheet.turn_speed };
    if (now.late) tables.lates[`${name} ${tier}`] = { ...lateTable(now, motors), joined: 2 * sheet.hull };
    else delete tables.lates[`${name} ${tier}`];
  }
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
        [at("wheel_speed_limit"), now.limit], [at("turn_speed"), sheet.turn_speed],
        [at("lag_decay"), decay], [at("lag_mean"), mean], ...Object.entries(answers(now)).map(([field, value]) => [at(field), value]),
        [at("hull_radius"), sheet.hull], ...("max_speed" in task.sheet ? [[at("max_speed"), top[0]]] : [])]);
    }
    for (const key of Object.keys(tables.pilots).filter((each) => each.startsWith(`${taskName} ${base} `))) {
      const recipe = tables.pilots[key];
      if (!recipe.sheet) continue;
      const [, , tier, ...label] = key.split(" ");
      const now = baseOf(sheet, tiers, tier);
      if (now.late && !task.late) continue; // no law drives such a base among bodies here
      const [decay, mean] = lagFactors(now.lag, DT);
      const kinds = { least: (number) => Math.min(number, now.acceleration), least_half: (number) => Math.min(number, 0.5 * now.acceleration), least_yaw: (number) => Math.min(number, now.yaw),
        share_yaw: (number) => number * now.yaw, late: () => now.lag + DT, most_yaw: () => top[1], decay: (step) => lagFactors(now.lag, step)[0], mean: (step) => lagFactors(now.lag, step)[1] };
      const at = (field) => recipe.sheet.plant + plant[field][0];
      const changes = [[at("hull_radius"), sheet.hull], [at("wheel_matrix"), matrix], [at("wheel_speed_limit"), now.limit], [at("turn_speed"), sheet.turn_speed], [at("acceleration"), now.surely[0]],
        [at("yaw_acceleration"), now.surely[1]], [at("lag"), now.lag], [at("lag_decay"), decay], [at("lag_mean"), mean], ...recipe.sheet.fields.map(([place, kind, number]) => [place, kinds[kind](number)])];
      // a gain that such a field holds counts up to what this base can do
      const limits = Object.fromEntries(gainsOf(kernels, taskName, recipe).gains.flatMap((gain) => recipe.sheet.fields
        .filter(([place, kind]) => kind.startsWith("least") && gain.places.some(([, offset]) => offset === place)).map(([, kind]) => [gain.name, kinds[kind](Infinity)])));
      tables.pilots[`${taskName} ${name} ${tier} ${label.join(" ")}`] = { ...recipe, limits, yaw: now.yaw,
        arguments: recipe.arguments.map((each) => (each.name === "params" ? { ...each, blob: patched(each.blob, changes) } : each)) };
    }
  }
  HULLS[name] = sheet.hull;
}
