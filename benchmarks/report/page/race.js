// Races against controllers: numbered challenges, a countdown, the result in the picture, medals, and a friend's ghost.

const RIVALS = ["astar_tracker", "vfh_plus", "orca_team", "reeds_shepp", "dwa", "lqr", "pure_pursuit"];
const BEST = "wayfield best times"; // in the browser's storage
const MEDALS = ["gold", "silver", "bronze"];
const ENDED = { success: "Finished in", collision: "Crashed after", left_corridor: "Off the path after", timeout: "Out of time:" };
const ENDINGS = { collision: "crashed", left_corridor: "left the path", timeout: "ran out of time" };
const ABOUT = "Beat the controllers by hand, or watch them drive.";

const still = () => window.matchMedia("(prefers-reduced-motion: reduce)").matches;

// A run by hand as a link holds it: how often each twist comes in a row.
function folded(tape) {
  const found = [];
  for (const twist of tape) {
    const last = found[found.length - 1];
    if (last && twist.every((each, k) => each === last[k + 1])) last[0] += 1;
    else found.push([1, ...twist]);
  }
  return found;
}

function unfolded(value) {
  if (!Array.isArray(value) || value.length > MOST_POINTS) throw new Error(`ghost is no list of at most ${MOST_POINTS}`);
  const rows = value.map((row, k) => asNumbers(`ghost[${k}]`, row, 4));
  rows.forEach(([count], k) => { if (!Number.isInteger(count) || count < 1 || count > MOST_POINTS) throw new Error(`ghost[${k}][0] is ${count}; it must be a whole number from 1 to ${MOST_POINTS}`); });
  if (rows.reduce((sum, [count]) => sum + count, 0) > MOST_POINTS) throw new Error(`ghost has more than ${MOST_POINTS} steps`);
  return rows.flatMap(([count, ...twist]) => Array.from({ length: count }, () => twist));
}

class Race {
  constructor(drive) {
    this.drive = drive;
    this.replay = drive.replay;
    this.challenges = (drive.replay.told.demo || {}).challenges || [];
    this.run = null; // whose result is shown
    this.banner = el("div", { class: "banner", hidden: true, role: "status" });
    drive.replay.board.append(this.banner);
    if (this.challenges.length) this.lay();
    document.addEventListener("keydown", (event) => {
      if (event.key.toLowerCase() !== "r" || event.ctrlKey || event.metaKey || event.altKey || !this.drive.hand || /INPUT|SELECT/.test(event.target.tagName)) return;
      event.preventDefault();
      this.again();
    });
  }

  // The sentence and the three buttons above the picture.
  lay() {
    const button = (text, click) => el("button", { type: "button", on: { click } }, text);
    this.sentence = el("p", {});
    this.number = el("select", { "aria-label": "challenge", on: { change: () => this.open(Number(this.number.value)) } });
    this.list();
    const front = el("div", { class: "front" }, this.sentence, el("div", { class: "large" }, button("Race it", () => this.start()), button("Draw a path", (event) => this.draw(!event.detail)), button("Put things in its way", (event) => this.put(!event.detail))),
      el("label", { class: "numbers" }, "challenge ", this.number));
    this.replay.app.before(front);
    new ResizeObserver(this.replay.place).observe(front);
  }

  tellScene() {
    if (!this.sentence) return;
    const { told: { demo }, world } = this.replay;
    this.sentence.textContent = `${world.family}` === demo.opening.place.family.split(": ")[1] && this.replay.other ? demo.sentence : ABOUT;
  }

  get best() {
    try {
      return JSON.parse(localStorage.getItem(BEST)) || {};
    } catch {
      return {}; // a browser that keeps nothing
    }
  }

  list() {
    const { best } = this;
    const now = this.number.value;
    this.number.replaceChildren(...this.challenges.map(({ name }, k) => {
      const found = best[this.key(k)];
      return el("option", { value: k }, `${k + 1}. ${name}${found ? `: ${found.time.toFixed(2)} s${found.medal ? `, ${found.medal}` : ""}` : ""}`);
    }));
    this.number.value = now || String(Math.max(this.challenges.findIndex((_, k) => !best[this.key(k)]), 0));
  }

  key(k) {
    const { family, seed, robot } = this.challenges[k];
    return `${family} ${seed} ${robot}`;
  }

  // The challenge that is on the screen as it is for everybody, or -1.
  get now() {
    const { drive, replay } = this;
    const place = picks && picks.state();
    if (!place || replay.world.edited || drive.tier.value !== "lagged" || drive.disturbance.value !== "none") return -1;
    return this.challenges.findIndex(({ family, seed, robot }) => family === place.family && seed === place.seed && robot === replay.robot);
  }

  start() {
    if (this.drive.runs.some((run) => run.asked.label === GHOST)) this.again();
    else this.open(Number(this.number.value));
  }

  // A scene of the page, as everybody gets it.
  place({ family, seed, robot }) {
    const { drive } = this;
    [drive.robot.value, drive.tier.value, drive.disturbance.value, drive.from.value] = [robot, "lagged", "none", "the start"];
    picks.restore({ family, seed });
  }

  open(k) {
    this.place(this.challenges[k]);
    this.number.value = String(k);
    this.again();
  }

  again() {
    this.drive.who.value = KEYBOARD;
    this.drive.go();
  }

  draw(keys) {
    this.place(this.challenges[0]);
    this.drive.editor.take("path", keys);
  }

  put(keys) {
    const { drive, replay } = this;
    if (replay.other || replay.world.path || !replay.world.goal) {
      this.place(replay.told.demo.free);
      drive.go();
    }
    drive.editor.take("disc", keys);
  }

  // Who drives beside the hand: a trained network, and controllers.
  rivals() {
    const { drive } = this;
    if (this.replay.actors.some((actor) => actor.told)) return [];
    const able = drive.able();
    return [...new Set([drive.usual(able), ...RIVALS.filter((each) => able.includes(each))])].filter(Boolean).slice(0, 3);
  }

  countDown() {
    const asked = this.replay.world.path ? "Follow the path to the star." : "Drive to the star.";
    this.run = null;
    const show = (count) => {
      if (!count) { this.go(); return; }
      this.say(el("strong", {}, String(count)), el("p", {}, `${asked} Arrow keys or the buttons in the picture.`));
      this.timer = setTimeout(() => show(count - 1), 700);
    };
    if (still()) this.say(el("p", {}, `${asked} Your first key or pad press starts the clock.`));
    else show(3);
  }

  go() {
    clearTimeout(this.timer);
    if (!this.run) this.banner.hidden = true;
    this.replay.toggle(true);
  }

  clear() {
    clearTimeout(this.timer);
    this.run = null;
    this.banner.hidden = true;
  }

  say(...parts) {
    this.banner.replaceChildren(...parts.filter(Boolean));
    this.banner.hidden = false;
  }

  over(run) {
    this.run = run;
    this.nth = this.now;
    this.tell();
  }

  // The result, large in the picture; again as each of the others ends.
  tell(told = "") {
    const { run, drive, replay } = this;
    if (!run) return;
    const seconds = ({ x }) => `${((x.length - 1) * DT).toFixed(1)}\u00a0s`;
    const others = replay.actors.filter((actor) => actor !== run.actor && !actor.ghost);
    const word = (actor) => (!actor.outcome ? "still drives" : actor.outcome === "success" ? seconds(actor) : ENDINGS[actor.outcome]);
    const medal = this.medal(others);
    const button = (text, click, attributes = {}) => el("button", { type: "button", ...attributes, on: { click } }, text);
    const next = this.nth >= 0 && this.nth + 1 < this.challenges.length && run.actor.outcome === "success";
    this.say(el("strong", { class: run.actor.outcome === "success" ? "" : "bad" }, `${ENDED[run.actor.outcome]} ${seconds(run.actor)}`),
      medal ? el("p", { class: `medal ${medal}` }, `${medal} medal`) : null,
      el("p", {}, `You ${word(run.actor)}, ${others.map((actor) => `${actor.label} ${word(actor)}`).join(", ")}.`),
      el("div", { class: "files" }, button("Try again (R)", () => this.again(), { class: "go" }), next ? button("Next challenge", () => this.open(this.nth + 1)) : null,
        button("Copy a link to race this run", async () => this.tell(await drive.share.link())), button("close", () => { this.clear(); })), told ? el("p", { class: "note" }, told) : null);
  }

  // By the times of the controllers; the best time of a challenge is kept.
  medal(others) {
    const { actor } = this.run;
    const rivals = others.filter((each) => each.policy !== GHOST && each.policy !== KEYBOARD);
    if (actor.outcome !== "success") return "";
    const faster = rivals.filter((each) => each.outcome === "success" && each.x.length <= actor.x.length).length;
    const medal = rivals.length && rivals.every((each) => each.outcome) ? MEDALS[Math.min(faster, 2)] : "";
    const [k, time, { best }] = [this.nth, (actor.x.length - 1) * DT, this];
    if (k < 0) return medal;
    const before = best[this.key(k)];
    if (!before || time < before.time || (time === before.time && medal && !before.medal)) {
      try {
        localStorage.setItem(BEST, JSON.stringify({ ...best, [this.key(k)]: { time, medal } }));
        this.list();
      } catch { /* a browser that keeps nothing */ }
    }
    return medal;
  }

  // A friend's run came by a link.
  challenged(run) {
    this.say(el("strong", {}, "A friend drove this"), el("p", {}, "Can you do better?"),
      el("div", { class: "files" }, el("button", { type: "button", class: "go", on: { click: () => this.again() } }, "Race the ghost"), el("button", { type: "button", on: { click: () => this.clear() } }, "watch first")));
    this.drive.replay.choose(run.actor);
  }
}
