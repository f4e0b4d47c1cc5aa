// Shares what is shown: a link that holds all of it, and the Python that drives the same run.

const LINK = 2; // version of what a link holds
const STATE = ["v", "robot", "actuators", "disturbance", "policy", "sheet", "place", "world", "runs", "step", "overlay", "ghost", "eased", "beside", "embed"];
const WORLD = ["kind", "name", "family", "tier", "quantity", "steps", "speed", "path", "closed", "laps", "corridor", "start", "start_offset", "start_turn", "goal", "waypoints", "obstacles", "patrols", "walls", "grid", "draws", "seed", "edited",
  "position_tolerance", "heading_tolerance", "waypoint_radius", "starts", "goals", "tracks", "walks", "bodies", "reach", "own"];
const EMBEDS = ["law", "scenes"]; // what a small simulator is about: its gains, or what there is to drive in
const LONG = 2000; // characters of a link

const fileName = () => decodeURIComponent(location.pathname.split("/").pop()); // of this page

class Share {
  constructor(drive) {
    this.drive = drive;
    this.replay = drive.replay;
    this.told = el("p", { class: "note", role: "status" });
    this.field = el("input", { type: "text", placeholder: "paste a friend's link here", "aria-label": "a friend's link", on: { input: () => {
      this.part.append(this.told);
      this.told.textContent = "";
      this.paste(this.field.value, (text) => { this.told.textContent = text; });
    } } });
    this.part = el("details", { open: true }, el("summary", {}, "Share"), el("div", { class: "files" }, button("copy link", async () => { this.part.append(this.told); this.told.textContent = await this.link(); }), this.field), this.told);
    // a link that is pasted into the page, or into its address, is opened
    document.addEventListener("paste", (event) => {
      if (!/INPUT|SELECT/.test(event.target.tagName)) this.paste(event.clipboardData.getData("text"));
    });
    window.addEventListener("hashchange", () => { if (location.hash && location.hash !== "#replay") this.paste(location.hash); });
  }

  // Opens a link that was pasted; where that cannot be, what was shown stays.
  paste(text, tell = problem) {
    const [, held] = text.trim().split("#");
    if (!held) {
      if (tell !== problem && text) tell(`That is no link to a run. One looks like ${(this.replay.told.demo || {}).site || `file:///…/${fileName()}`}#%7B%22v%22…: paste all of it.`);
      return;
    }
    const before = encodeURIComponent(JSON.stringify(this.state()));
    let left = false;
    try {
      this.read(held);
      left = true;
      this.restore(held, false, true);
      byId("problem").hidden = true;
      this.field.value = "";
      this.replay.canvas.focus({ preventScroll: true });
      history.replaceState(null, "", `#${held}`);
      setTimeout(() => window.scrollTo({ top: 0, behavior: "instant" }), 0); // after the browser has shown where the text went
    } catch (error) {
      if (left) this.restore(before);
      history.replaceState(null, "", `#${before}`);
      tell(`The link cannot be opened: ${error.message}. What was shown stays.`);
    }
  }

  // All that decides what is shown, as plain values.
  state() {
    const { drive, replay } = this;
    const { world } = replay;
    const place = picks.state();
    const runs = drive.runs.filter((run) => !run.reference && ![KEYBOARD, FRIEND].includes(run.asked.label) && !run.asked.from).map(({ asked: { label, gains } }) => ({ policy: label, ...(Object.keys(gains).length ? { gains } : {}) }));
    const own = world.edited || !place;
    const byHand = drive.runs.find((run) => run.tape.length && !run.asked.from);
    return { v: LINK, robot: replay.robot, actuators: drive.tier.value, disturbance: drive.disturbance.value, policy: drive.who.value,
      ...(replay.robot in drive.sheets ? { sheet: drive.sheets[replay.robot] } : {}), ...(place ? { place } : {}), ...(own ? { world: stripped(world) } : {}), runs, step: byHand ? 0 : replay.step, ...(drive.looks.on ? { overlay: true } : {}), ...(byHand ? { ghost: folded(byHand.tape) } : {}), ...(byHand && easedBy(byHand) ? { eased: [byHand.slow ?? 1, Boolean(byHand.halted)] } : {}), ...(replay.other ? { beside: replay.other.label } : {}) };
  }

  async link() {
    const { replay } = this;
    const state = JSON.stringify(this.state());
    const { site } = replay.told.demo || {};
    const url = `${site || location.href.split("#")[0]}#${encodeURIComponent(state)}`;
    history.replaceState({ own: true }, "", `#${encodeURIComponent(state)}`); // who loads the page again is no friend
    const there = await copied(url);
    if (!there) { this.field.value = url; this.field.select(); }
    const told = there ? "Link copied." : "The browser lets nothing be copied: the link stands in the address bar, and in the field under Share.";
    const long = url.length > LONG ? ` It is long, ${url.length} characters: some chats cut it.` : "";
    return site || location.protocol !== "file:" ? `${told}${long}` : `${told} It works on this computer only, as this page is a file here. To send the run: send the file ${fileName()} and the link; your friend opens the file and pastes the link there, under Share.${long}`;
  }

  // What a link holds, checked as far as that changes nothing of the page; an Error says what is wrong with it.
  read(text) {
    const { drive } = this;
    let state;
    try {
      state = parsed(decodeURIComponent(text));
    } catch (error) {
      throw error instanceof SyntaxError || error instanceof URIError ? new Error("it is cut off or was changed") : error;
    }
    if (typeof state !== "object" || state === null || state.v !== LINK) throw new Error(`its version is ${quoted(state && state.v)}, and this page reads ${LINK}: open it in the page that made it`);
    onlyFields(state, STATE);
    const known = (field, options, of = state) => {
      if (!options.includes(of[field])) throw new Error(`${field} is ${quoted(of[field])}; it must be one of ${options.join(", ")}`);
    };
    const object = (field, value) => {
      if (typeof value !== "object" || value === null || Array.isArray(value)) throw new Error(`${field} is ${quoted(value)}; it must be an object {...}`);
    };
    for (const field of ["sheet", "place"]) if (state[field] !== undefined) object(field, state[field]);
    if (state.place !== undefined) picks.check(state.place);
    if (state.step !== undefined && !(Number.isInteger(state.step) && state.step >= 0)) throw new Error(`step is ${quoted(state.step)}; it must be a whole number of at least 0`);
    if (state.overlay !== undefined && state.overlay !== true) throw new Error(`overlay is ${quoted(state.overlay)}; it must be true or left out`);
    if (state.eased !== undefined && !(Array.isArray(state.eased) && RATES.includes(state.eased[0]) && typeof state.eased[1] === "boolean" && state.eased.length === 2)) throw new Error(`eased is ${quoted(state.eased)}; it must be a speed and whether there were pauses`);
    const { kind } = state.world || { kind: `${(state.place || {}).family}`.split(":")[0] };
    const task = taskOf(drive.kernels, { kind });
    const own = state.sheet !== undefined && drive.free ? [sheetOf(state.sheet, drive.kernels.tables.sheet).name] : [];
    if (drive.free) known("robot", [...robotsOf(drive.kernels, task), ...own]);
    const conditions = { actuators: drive.kernels.tables.tiers, disturbance: Object.keys(drive.kernels.tables.disturbances) };
    for (const [field, options] of Object.entries(conditions)) known(field, options);
    if (state.embed !== undefined && !EMBEDS.includes(state.embed)) throw new Error(`embed is ${quoted(state.embed)}; it must be one of ${EMBEDS.join(", ")}`);
    if (!Array.isArray(state.runs) || state.runs.length > 60) throw new Error("runs must be a list of at most 60");
    state.runs.forEach((run, k) => {
      object(`runs[${k}]`, run);
      onlyFields(run, ["policy", "gains"], `runs[${k}]: `);
      if (drive.free && !own.length) known("policy", pilotsOf(drive.kernels, task, state.robot, state.actuators), run);
    });
    if (drive.free && !own.length && state.policy !== undefined) known("policy", [KEYBOARD, ...pilotsOf(drive.kernels, task, state.robot, state.actuators)]);
    const world = state.world === undefined ? null : checkedWorld(state.world);
    if (state.place === undefined && !world) throw new Error("it names no scenario");
    return { state, world, ghost: state.ghost === undefined ? null : unfolded(state.ghost) };
  }

  // Shows what a link holds; an Error says what is wrong with it.
  restore(text, own = false, sent = false) {
    const { drive, replay } = this;
    const { state, world, ghost } = this.read(text);
    if (state.sheet !== undefined && drive.free) drive.adopt(state.sheet);
    if (state.embed) this.embed(state.embed);
    drive.editor.take(null);
    if (drive.free) { replay.robot = state.robot; drive.robot.value = state.robot; }
    if (state.place !== undefined) picks.restore(state.place, !world);
    if (world) {
      const { original } = drive;
      drive.editor.open(world, world.name === "drawn" ? "A path that was drawn." : "A scene that was edited.", state.place === undefined);
      if (state.place !== undefined && original) { drive.original = original; drive.world = world; }
    }
    drive.tier.value = state.actuators;
    drive.disturbance.value = state.disturbance;
    drive.offer();
    const able = drive.able();
    for (const run of state.runs) {
      if (!able.includes(run.policy)) throw new Error(`policy is ${quoted(run.policy)}; here drive ${able.join(", ")}`);
      const gains = checkedGains(run.gains, drive.gains.recipe(run.policy));
      drive.who.value = run.policy;
      drive.gains.offer();
      if (Object.keys(gains).length) drive.gains.setAll(gains);
      else drive.add({ label: run.policy });
    }
    if (able.includes(state.policy)) drive.who.value = state.policy;
    drive.chosenPolicy();
    if (state.beside !== undefined) {
      const other = replay.actors.find((actor) => [actor.label, actor.policy].includes(state.beside));
      if (!other) throw new Error(`beside is ${quoted(state.beside)}; the runs are ${replay.actors.map((actor) => actor.label).join(", ")}`);
      replay.split(other);
    }
    if (state.overlay === true) drive.looks.turn(true);
    const friend = ghost && drive.add({ label: FRIEND, tape: ghost });
    if (friend && state.eased) [friend.slow, friend.halted] = state.eased;
    if (friend && own) [friend.actor.own, friend.actor.label] = [true, "your last run"];
    if (state.step) drive.pump(AHEAD);
    replay.stretch();
    replay.seek(state.step ?? 0);
    drive.wake();
    drive.race.tellScene();
    if (friend) drive.race.challenged(friend);
    else if (sent && !state.embed) drive.race.received();
    if (state.embed && !still()) replay.toggle(true);
  }

  // A small simulator inside another page: the picture and what that page is about.
  embed(kind) {
    const { drive, replay } = this;
    document.body.dataset.embed = kind;
    drive.gains.part.open = kind === "law";
    replay.side.append(drive.gains.part);
    const whole = el("a", { href: "#", target: "_blank", class: "whole-page", on: { click: () => {
      whole.href = `${location.href.split("#")[0]}#${encodeURIComponent(JSON.stringify(this.state()))}`;
    } } }, "whole simulator ↗");
    replay.bar.append(whole);
    replay.fit();
  }

  async python() {
    const { drive, replay } = this;
    const run = drive.runs.find((each) => each.actor === replay.chosen) || drive.runs[0];
    drive.named.before(this.told); // beside the button
    if (!run || (run === drive.hand && !run.tape.length)) { this.told.textContent = "Drive first: the code drives that run again."; return; }
    if (run.asked.from) { this.told.textContent = "This run began in the middle of another; the code drives runs from the start."; return; }
    const text = pythonOf(drive, run);
    this.told.textContent = (await copied(text)) ? `Python copied: it drives “${run.actor.label}” again${run.asked.conditions.disturbance === "none" ? ", to the last bit" : "; disturbed runs draw other noise than the page"}. It needs the package; in a clone of it: pip install .` : "The browser allows no copy.";
  }
}

// A world without what the page adds by itself.
function stripped(world) {
  const { made, closing, hull, own, ...rest } = world;
  return own ? { ...rest, own } : rest;
}

// A world that came by a link: only numbers, lists and the few words that worlds have.
function checkedWorld(world) {
  if (typeof world !== "object" || world === null || Array.isArray(world)) throw new Error("its scene is no object");
  onlyFields(world, WORLD, "of its scene ");
  for (const field of ["kind", "name", "family", "tier"]) if (typeof world[field] !== "string" || world[field].length > 200) throw new Error(`its scene's ${field} is ${quoted(world[field])}; it must be a text of at most 200 characters`);
  if (!["path", "goal", "dock", "team", "people"].includes(world.kind)) throw new Error(`its scene's kind is ${quoted(world.kind)}`);
  const rows = (field, width, most) => {
    const value = world[field] || [];
    if (!Array.isArray(value) || value.length > most) throw new Error(`its scene's ${field} is no list of at most ${most}`);
    return value.map((row, k) => asNumbers(`${field}[${k}]`, row, width));
  };
  const number = (field, least) => asNumber(field, world[field], least);
  if (!Number.isInteger(world.steps) || world.steps < 1) throw new Error(`steps is ${quoted(world.steps)}; it must be a whole number of at least 1`);
  for (const field of ["start_offset", "start_turn"]) number(field, 0);
  if (world.speed !== undefined) number("speed", 1e-3);
  for (const field of ["start", "goal"]) if (world[field]) asNumbers(field, world[field], 3);
  if (world.draws !== undefined) { if (!Array.isArray(world.draws)) throw new Error("its scene's draws are no list"); world.draws.forEach((each, k) => asNumber(`draws[${k}]`, each)); }
  const [path, obstacles, walls, patrols, waypoints] = [rows("path", 2, MOST_POINTS), rows("obstacles", 8, MOST_OBSTACLES), rows("walls", 8, MOST_POINTS), rows("patrols", 6, MOST_OBSTACLES), rows("waypoints", 2, MOST_OBSTACLES)];
  for (const [, , c, s, ...sizes] of [...obstacles, ...walls]) {
    if (Math.abs(c * c + s * s - 1) > 1e-6) throw new Error(`an obstacle's direction is [${c}, ${s}]; it must have the length 1`);
    for (const each of sizes) if (each < 0) throw new Error(`an obstacle's size or mass is ${each}; it must be at least 0`);
  }
  if (patrols.length && patrols.length !== obstacles.length) throw new Error(`patrols has ${patrols.length} rows; there are ${obstacles.length} obstacles`);
  const kept = { ...world, steps: Math.min(world.steps, 12000), edited: true, grid: undefined, own: 0 };
  if (world.kind === "path" || path.length) {
    if (path.length < (world.closed ? 3 : 2)) throw new Error(`path has ${path.length} points; it needs ${world.closed ? 3 : 2}`);
    path.forEach(([x, y], k) => { if (k && x === path[k - 1][0] && y === path[k - 1][1]) throw new Error(`path points ${k - 1} and ${k} are the same`); });
    number("corridor", 1e-3);
  }
  if (world.kind === "path") {
    number("laps", 0);
    return kept;
  }
  for (const field of ["start", "goal"]) if (!world[field]) throw new Error(`its scene lacks its ${field}`);
  for (const field of ["position_tolerance", "heading_tolerance", "waypoint_radius"]) number(field, 1e-6);
  return { ...kept, own: Math.floor(asNumber("own", world.own ?? 0, 0, obstacles.length)), obstacles, patrols, waypoints, ...(["team", "people"].includes(world.kind) ? checkedBodies(world, rows) : {}) };
}

// The other bodies of a world that came by a link: what the package's own check of such a scenario asks for.
function checkedBodies(world, rows) {
  const [starts, goals, tracks, walks] = [rows("starts", 3, MOST_BODIES), rows("goals", 3, MOST_BODIES), rows("tracks", 4, MOST_POINTS), rows("walks", WALK.length, MOST_BODIES)];
  if (starts.length !== goals.length) throw new Error(`its scene has ${starts.length} starts and ${goals.length} goals of other robots; there must be as many of either`);
  const whole = { law: [0, 8], then: [0, 4], blind: [0, 1], reaction: [0, 5], group: [0, MOST_BODIES], first: [0, MOST_POINTS], rows: [0, MOST_POINTS] };
  const ends = { ...whole, speed: [0, 3], radius: [0, 0.5], horizon: [1e-3, 1000], wall_horizon: [1e-3, 1000], frame_time: [0, 1000], share: [0, 1] };
  walks.forEach((walk, k) => {
    const of = (field) => walk[WALK.indexOf(field)];
    for (const [field, [least, most]] of Object.entries(ends)) asNumber(`walks[${k}].${field}`, of(field), least, most);
    for (const field of Object.keys(whole)) if (!Number.isInteger(of(field))) throw new Error(`walks[${k}].${field} is ${of(field)}; it must be a whole number`);
    const least = of("law") === REPLAYED ? 2 : of("then") === GOES_ON ? 1 : 0;
    if (of("rows") < least || (least && of("first") + of("rows") > tracks.length)) throw new Error(`walks[${k}] has rows ${of("first")} to ${of("first") + of("rows")} of tracks, which has ${tracks.length}; there must be at least ${least}`);
    if (of("law") === REPLAYED && !(of("frame_time") > 0)) throw new Error(`walks[${k}].frame_time is 0; of a recorded walk it must be more`);
  });
  const bodies = [...starts.map(() => null), ...walks.map((walk) => walk[WALK.indexOf("radius")])];
  return { starts, goals, tracks, walks, bodies, reach: asNumber("reach", world.reach, 1e-3, 1000) };
}

function checkedGains(gains, recipe) {
  if (gains === undefined) return {};
  if (typeof gains !== "object" || gains === null) throw new Error(`gains is ${quoted(gains)}; it must be an object {...}`);
  for (const [name, value] of Object.entries(gains)) {
    const gain = ((recipe && recipe.gains) || []).find((each) => each.name === name);
    if (!gain) throw new Error(`its policy has no gain ${quoted(name)}`);
    const { low, high, whole } = gain;
    if (whole && !Number.isInteger(value)) throw new Error(`${name} is ${quoted(value)}; it must be a whole number`);
    if (typeof value !== "number" || !(value >= low && value <= high)) throw new Error(`${name} is ${quoted(value)}; it must be from ${short(low)} to ${short(high)}`);
  }
  return gains;
}

// A person's numbers, in the order of the package's WALK.
const WALK = ["law", "x", "y", "goal_x", "goal_y", "gate_x", "gate_y", "gate_to_x", "gate_to_y", "speed", "radius", "then", "blind", "horizon", "wall_horizon", "margin", "share", "turn", "frame_time", "begins", "first", "rows", "group", "reaction"];
const [REPLAYED, GOES_ON, MOST_BODIES] = [6, 4, 64];

const tuple = (values) => `(${values.join(", ")}${values.length === 1 ? "," : ""})`;
const rowsOf = (rows) => `[\n${rows.map((row) => `        ${tuple(row)},\n`).join("")}    ]`;
const value = (x) => (x === "inf" ? 'float("inf")' : x === true ? "True" : x === false ? "False" : JSON.stringify(x));

// The Python that drives a run of the page again: the scene as numbers, the start where the page's draw put it.
function pythonOf(drive, { asked: { label, conditions, gains }, driven, actor }) {
  const { world } = drive.replay;
  const tables = drive.kernels.tables.tasks[drive.task];
  const probe = new Simulator(drive.kernels, world, { ...conditions, disturbance: "none" });
  probe.reset();
  const start = probe.pose;
  probe.free();
  const field = (name) => `    ${name}=${value(world[name])},`;
  const still = !world.start_offset && !world.start_turn;
  const lines = ["import gymnasium", "import numpy as np", "import wayfield", "from wayfield.policies import Pilot, make"];
  const records = recordsOf(world).map((row) => [...row.slice(0, -1), tuple(row[row.length - 1])]);
  const solids = `np.array(${records.length ? rowsOf(records) : "[]"}, OBSTACLE)`;
  let scene;
  if (world.kind === "path") {
    lines.push("from wayfield.envs.scenarios import PathScenario", "from wayfield.envs.world.paths import Path");
    scene = [`scenario = PathScenario(`, `    ${value(world.name)},`, `    Path(np.array(${rowsOf(world.path)}), closed=${value(world.closed)}),`, field("laps"), field("corridor"),
      ...(still && !world.start ? [] : [`    start=${tuple(start)},`]), ")"];
  } else if (world.walks) {
    lines.push("from wayfield.envs.crowds.people import WALK", "from wayfield.envs.scenarios.team_scenario import TeamScenario", "from wayfield.envs.world.geometry import OBSTACLE");
    const rows = (list, kind) => `np.array(${list.length ? rowsOf(list) : "[]"}${kind})`;
    scene = ["scenario = TeamScenario.made(", `    ${value(world.name)},`, `    starts=${rowsOf([start, ...world.starts])},`, `    goals=${rowsOf([world.goal, ...world.goals])},`,
      `    obstacles=${solids},`, `    walks=${rows(world.walks, ", WALK")},`, `    tracks=${rows(world.tracks, ", float")}.reshape(-1, 4),`,
      field("reach"), field("position_tolerance"), field("heading_tolerance"), ")"];
  } else {
    const [room, kind] = tables.scenario;
    lines.push(`from ${room} import ${kind}`, "from wayfield.envs.world.geometry import OBSTACLE");
    scene = [`scenario = ${kind}(`, `    ${value(world.name)},`, `    goal=${tuple(world.goal)},`, `    start=${tuple(start)},`,
      `    waypoints=${tuple(world.waypoints.map(tuple))},`.replace("((),)", "()"), `    obstacles=${solids},`,
      field("position_tolerance"), field("heading_tolerance"), field("waypoint_radius"), ")"];
  }
  const kwargs = Object.entries(tables.kwargs).map(([name, each]) => `, ${name}=${value(each)}`).join("");
  const disturbed = conditions.disturbance === "none" ? "" : `, disturbance=${value(conditions.disturbance)}`;
  const id = tables.ids[conditions.robot];
  const made = [`env = gymnasium.make(`, `    ${value(id)}, scenario=scenario, robot=${value(conditions.robot in drive.sheets ? `${conditions.robot}.json` : conditions.robot)}, actuators=${value(conditions.actuators)}${disturbed},`,
    `    max_episode_steps=${world.steps}${kwargs},`, ")"];
  const recipe = drive.kernels.tables.pilots[`${drive.task} ${conditions.robot} ${conditions.actuators} ${label}`];
  const mine = recipe ? { ...recipe.make.gains, ...askedOf(drive.kernels, drive.task, recipe, world), ...gains } : {};
  const told = Object.entries(mine).map(([name, each]) => `, ${name}=${value(each)}`).join("");
  const axes = tables.robots[conditions.robot].axes;
  const asked = (twist) => tuple(axes.map((axis) => (twist ? twist[axis] : 0)));
  const loop = driven ? [`commands = [${driven.map((all) => (world.walks ? (world.starts.length ? tuple(all.map(asked)) : asked(all[0])) : asked(all))).join(", ")}]`, "observation, info = env.reset(seed=0)", "for command in commands:",
    "    observation, reward, terminated, truncated, info = env.step(np.array(command))"]
    : [`pilot = Pilot(make(${value(recipe.make.name)}${told}), env)`, "observation, info = env.reset(seed=0)", "pilot.reset()", "terminated = truncated = False", "while not (terminated or truncated):",
      "    observation, reward, terminated, truncated, info = env.step(pilot.command(observation))"];
  return [`# ${actor.label}, ${world.name}: the run of the page`, ...lines, "", ...scene, ...made, ...loop, `print(info["success"], info["time"])`, ""].join("\n");
}

// Whether the page was opened by a link, and shows what that holds.
function restored() {
  const text = location.hash.slice(1);
  if (!text || text === "replay") return false; // the link that skips to the simulator
  try {
    const own = Boolean(history.state && history.state.own);
    drive.share.restore(text, own, !own);
    return true;
  } catch (error) {
    problem(`The link cannot be opened: ${error.message}. The page shows its first scenario.`);
    return false;
  }
}
