// Races against controllers and a network: numbered challenges, the result, medals, and a friend's run.

const RIVALS = ["astar_tracker", "vfh_plus", "reeds_shepp", "orca_team", "polar", "dwa", "lqr", "pure_pursuit"];
const BEST = "wayfield best times"; // in the browser's storage
const MEDALS = ["gold", "silver", "bronze"];
const WITHIN = 1.25; // of the quickest controller's time, in whole seconds: bronze
const ENDED = { success: "Finished in", collision: "Crashed after", left_corridor: "Left the grey band after", timeout: "Out of time:", left: "Drove off after", stopped: "Stopped after" };
const ABOUT = "Beat controllers and a trained network by hand, or watch them drive.";
const ASKED = { path: "Stay on the grey band to the star, or the run ends", dock: "Park on the star, facing the way its line points" };
const ROUND = "Drive once round on the grey band, the way you face, back to the star: off it the run ends";
const NEAR_MISS = 0.5; // m
const LONG_LINE = 120; // characters that two lines hold
const things = (count) => (count === 1 ? "a thing" : `${count} things`);
const coarse = () => window.matchMedia("(pointer: coarse)").matches;

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

// What made a run by hand easier than it is, in words; "" where nothing did.
function easedBy({ slow = 1, halted = false }) {
  return [slow < 1 && `at ${slow === 0.5 ? "half" : "a quarter of the"} speed`, halted && "with pauses"].filter(Boolean).join(", ");
}

class Race {
  constructor(drive) {
    this.drive = drive;
    this.replay = drive.replay;
    this.challenges = (drive.replay.told.demo || {}).challenges || [];
    this.run = null; // whose result is shown
    this.watched = null; // a friend's run, while it is looked at
    this.sent = false; // whether the scene came by a link
    this.banner = el("div", { class: "banner", hidden: true, role: "status" }); // a word in the picture
    this.card = el("div", { class: "card", hidden: true, role: "status" }); // the result beside it
    // it comes where a thumb may still press the pad: a press counts that began on the card
    this.card.addEventListener("pointerdown", () => { this.pressed = true; });
    this.card.addEventListener("click", (event) => { if (event.detail && !this.pressed) event.stopPropagation(); }, true);
    drive.replay.board.append(this.banner);
    drive.replay.quick.prepend(this.card);
    if (this.challenges.length) this.lay();
    document.addEventListener("keydown", (event) => {
      const key = event.key.toLowerCase();
      const act = key === "r" ? (this.drive.hand || this.watched || !this.card.hidden) && (() => this.again()) : !this.card.hidden && (key === "escape" ? () => this.close() : key === "enter" && this.run && !event.repeat && event.target.tagName !== "BUTTON" && /* that of a pasted link starts no race */ (() => this.card.querySelector(".go").click()));
      if (!act || event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT/.test(event.target.tagName)) return;
      event.preventDefault();
      act();
    });
  }

  // The sentence and the three buttons above the picture; what a tool or a law's thinking is about takes the sentence's place.
  lay() {
    const { replay } = this;
    this.sentence = el("p", { class: "sentence", role: "status" });
    this.number = el("select", { "aria-label": "challenge", on: { change: () => this.open(Number(this.number.value)) } });
    replay.words.append(this.sentence);
    this.large = [button("Race it", () => (this.opening ? this.open(this.due) : this.start())), button("Draw a path", (event) => this.draw(!event.detail)), button("Put things in its way", (event) => this.put(!event.detail))];
    const front = el("div", { class: "front" }, replay.words, el("div", { class: "large" }, this.large),
      el("label", { class: "numbers" }, "challenges", this.number));
    this.list();
    replay.app.before(front);
    new ResizeObserver(replay.place).observe(front);
  }

  tellScene() {
    if (!this.sentence) return;
    const { replay, replay: { told: { demo }, world } } = this;
    const { hand: run, editor } = this.drive;
    const hand = run && !run.actor.outcome;
    const modes = [hand && !editor.stays, editor.stays && editor.tool === "path", editor.stays && editor.tool === "disc"];
    this.large[0].textContent = !this.opening ? "Race it" : this.due ? `Go on: challenge ${this.due + 1}` : "Start easy: challenge 1";
    this.large.forEach((button, k) => button.setAttribute("aria-pressed", Boolean(modes[k])));
    const friend = replay.actors.find(({ policy }) => policy === FRIEND);
    const text = hand ? this.asked(run) : this.run ? `Try again, ${this.run.actor.outcome === "success" ? "take another challenge, or send a friend your run" : "or take another challenge"}.` : friend ? (friend.own ? "This is your last run: can you beat it?" : "A friend sent you this run: race it, or watch it first.") : this.sent ? this.came() : this.opening ? demo.sentence : this.closest() || ABOUT;
    this.headline(text);
    const here = this.now;
    if (this.opening) this.sentence.append(" ", button(`race this scene (challenge ${here + 1})`, () => this.open(here)));
    this.number.value = here < 0 || this.opening ? "" : String(here);
    const verdict = !editor.stays ? "" : editor.tool === "path" ? this.closest() : world.own ? this.verdict() : "";
    if (verdict) editor.tell(`${verdict} ${editor.tool === "path" ? "Draw another line as you like." : `Click or tap for another ${editor.tool}.`}`);
    else if (this.told) editor.tell((editor.tool === "path" ? AGAIN : HINTS)[editor.tool] || "");
    this.told = verdict; // it goes as the end of the runs leaves the picture
  }

  // Of a scene that came by a link: what its sender did to it.
  came() {
    const { playing, world: { own, edited, name } } = this.replay;
    const what = name === "drawn" ? "A line that a friend drew" : "This scene";
    const how = own ? `, with ${things(own)} that ${name === "drawn" ? "they" : "a friend"} placed` : edited && name !== "drawn" ? ", which a friend changed" : "";
    return `${what}${how}${how ? "," : ""} came by a link${playing ? "" : ": “play” shows it"}.`;
  }

  // Long ones are smaller: the picture below stays where it is.
  headline(text) {
    this.sentence.textContent = text;
    this.sentence.classList.toggle("long", text.length > LONG_LINE);
  }

  // Whether there is still what the page opened on: too hard for a first race.
  get opening() {
    const { told: { demo: { opening } }, chosen, other } = this.replay;
    const { family, seed } = this.challenges[this.now] || {};
    return Boolean(other) && !this.drive.hand && chosen.policy === opening.policy && other.policy === opening.beside && family === opening.place.family && seed === opening.place.seed;
  }

  // What the hand is to do; once nobody else is on the way, how to begin anew.
  asked(run) {
    const { replay } = this;
    const astray = Math.ceil((run.limit - run.away) * DT);
    const first = run.out ? "You are out of the scene: turn back to the star" : this.near(run) ? "Bring your middle into the ring" : "";
    if (run.tape.length && run.away * DT > 0.5) {
      const rests = run.tape[run.tape.length - 1].every((each) => !each);
      const what = first || (run.grows ? "This leads away: turn back" : rests ? "You are standing still: drive on" : `Come nearer to the ${run.aim < (replay.world.waypoints || []).length ? "next ring" : "star"}`);
      return `${what}, or the run ends in ${astray} s.`;
    }
    if (run.tape.length && first) return `${first}.`;
    if (run.tape.length && this.late) return "The others have ended. Drive on, or press “Race it” to start again.";
    const omni = run.simulator.body.axes.length > 2;
    const seen = Math.sin(run.actor.heading[0]) < -0.3 ? ", as the robot sees it" : ""; // it faces down the screen
    const turn = coarse() ? `hold “ahead”${omni ? ", “go left” or “go right”" : `, turn by “left” and “right”${seen}`}` : `hold ↑, turn by ← and →${seen}${omni ? "; A and D go sideways" : ""}`;
    const { limits } = this;
    const [count, found] = [replay.actors.filter(({ ghost, policy }) => !ghost && policy !== FRIEND).length, this.best[this.now < 0 ? "" : this.key(this.now)]];
    const prize = `${limits && limits[0] < Infinity ? `${MEDALS.map((each, k) => `${each} ${replay.scored(limits[k])}`).join(", ")}. `.replace("g", "G") : ""}${found ? `Your best: ${found.time.toFixed(2)} s. ` : ""}`;
    return `${(replay.world.kind === "path" && replay.world.closed && ROUND) || ASKED[replay.world.kind] || ((replay.world.waypoints || []).length ? "Drive through the rings, in order, to the star" : "Drive to the star")}: ${turn}. ${run.tape.length ? count > 1 ? `You pass through the other racers${replay.world.bodies ? `; each has its own ${companyOf(replay.world)}` : ""}.` : "" : `${prize}The clock waits for your first press.`}`;
  }

  // How near the hand is to the ring of the star that it did not get into (m); 0 where that is far, or not next.
  near({ aim, actor: { x, y } }, all = false) {
    const { goal, waypoints = [], position_tolerance: radius } = this.replay.world;
    if (!goal || aim < waypoints.length) return 0;
    const off = Math.min(...Array.from(x).slice(all ? 0 : -1).map((each, k) => Math.hypot(each - goal[0], y[all ? k : y.length - 1] - goal[1]))) - radius;
    return off > 0 && off < NEAR_MISS ? off : 0;
  }

  // What a run by hand that crashed ran into, or another robot of its team.
  hit({ actor }) {
    return [...hitsOf(this.replay.world, actor, HULLS[this.replay.robot])].sort((a, b) => a.row - b.row)[0];
  }

  // How it ended, before its time.
  how(run) {
    return (this.hit(run) || {}).row ? "Team crash after" : ENDED[run.actor.outcome];
  }

  // Why a run by hand ended before the star, in a sentence.
  why(run) {
    const { outcome } = run.actor;
    const off = outcome !== "success" && this.near(run, true);
    const { row, what, shape = [] } = this.hit(run) || {};
    const text = what ? `${row ? "A robot of your team" : "You"} hit ${what}${shape[4] ? "" : ", ringed in red"}.` : { left: `For ${OUT} s you were out of the scene and came no nearer to the star.`, stopped: `The others had ended, and for ${LOST} s you came no nearer to the star.` }[outcome] || "";
    return `${text}${off ? ` You passed ${Math.max(Math.round(100 * off), 1)} cm from the ring: your middle must be in it.` : ""}`.trim();
  }

  // What the medals need, gold first, in what runs are compared by; null while the quickest controller is not known.
  get limits() {
    const { replay } = this;
    const rivals = replay.actors.filter(({ ghost, policy }) => !ghost && ![KEYBOARD, FRIEND].includes(policy));
    const gold = Math.min(...rivals.filter(({ outcome }) => outcome === "success").map((each) => replay.score(each)));
    if (!rivals.length || rivals.some(({ outcome, x }) => !outcome && (replay.byError || (x.length - 1) * DT <= gold))) return null;
    const bronze = replay.byError ? WITHIN * gold : Math.ceil((WITHIN * gold).toFixed(6)); // whole seconds
    const silver = 0.5 * (gold + bronze);
    return [gold, replay.byError ? silver : Number(silver.toFixed(1)), bronze];
  }

  // And in words, with the rule.
  get rule() {
    const { limits, replay } = this;
    if (!limits) return "";
    const [gold, silver, bronze] = limits.map((each) => replay.scored(each));
    return limits[0] < Infinity ? `Gold ${gold} (${replay.byError ? "closest" : "quickest"} rival), silver ${silver} (half way from gold to bronze), bronze ${bronze} (${WITHIN} × gold${replay.byError ? "" : ", rounded up to a whole second"}).` : "No rival arrives: any finish is gold.";
  }

  // The first challenge without a medal.
  get due() {
    const { best } = this;
    return Math.max(this.challenges.findIndex((_, k) => !(best[this.key(k)] || {}).medal), 0);
  }

  // Whether nobody else is on the way.
  get late() {
    const { replay, drive: { hand } } = this;
    const others = replay.actors.filter((actor) => actor !== hand.actor);
    return others.length > 0 && others.every(({ outcome, x }) => outcome && replay.step >= x.length - 1);
  }

  // While the hand drives: what it is told changes once it does, and once the others have ended.
  watch() {
    const told = this.asked(this.drive.hand);
    if (this.sentence && this.sentence.textContent !== told) this.headline(told);
  }

  // Whether the picture shows how all runs ended.
  get done() {
    const { replay, drive: { runs } } = this;
    return runs.length > 0 && runs.every(({ actor }) => replay.tells(actor) && replay.step >= actor.x.length - 1);
  }

  // How the runs ended among what was put in their way.
  verdict() {
    const { drive: { runs } } = this;
    if (!this.done) return "";
    if (runs.length > 2) return `${runs.filter(({ actor }) => actor.outcome === "success").length} of ${runs.length} arrived.`;
    return `${runs.map(({ actor }) => `${actor.label} ${actor.end || OUTCOMES[actor.outcome]}`).join(", ")}.`;
  }

  // Along a path that was drawn: who kept to it best, where no hand raced them in time.
  closest() {
    const { replay, drive: { runs } } = this;
    if (!replay.byError || replay.world.name !== "drawn" || runs.length < 2 || !this.done) return "";
    const there = runs.filter(({ actor }) => actor.outcome === "success").sort((a, b) => a.measures.error - b.measures.error);
    return there.length ? `Closest to your line: ${replay.nameOf(there[0].actor)}, typically ${millimetres(there[0].measures.error)} mm off. ${there.length} of ${runs.length} arrived.` : "None got to the end of your line.";
  }

  get best() {
    try {
      return JSON.parse(localStorage.getItem(BEST)) || {};
    } catch {
      return {}; // a browser that keeps nothing
    }
  }

  // The challenges with their best times; that one is chosen that is on the screen.
  list() {
    const { best } = this;
    this.number.replaceChildren(el("option", { value: "", disabled: true }, "choose a challenge"), ...this.challenges.map(({ name }, k) => {
      const found = best[this.key(k)];
      return el("option", { value: k }, `${k + 1}. ${name}${found ? `: ${found.medal ? `${found.medal}, ` : ""}${found.time.toFixed(2)} s` : ""}`);
    }));
    this.number.value = this.now < 0 ? "" : String(this.now);
  }

  key(k) {
    const { family, seed, robot } = this.challenges[k];
    return `${family} ${seed} ${robot}`;
  }

  // The challenge that is on the screen as it is for everybody, or -1.
  get now() {
    const { drive, replay } = this;
    const place = picks && picks.state();
    if (!place || replay.blank || replay.world.edited || drive.tier.value !== "lagged" || drive.disturbance.value !== "none") return -1;
    return this.challenges.findIndex(({ family, seed, robot }) => family === place.family && seed === place.seed && robot === replay.robot);
  }

  // Races in the scene on the screen, from where "begin at" says.
  start() {
    this.replay.split(null);
    this.drive.go(true, KEYBOARD);
    this.drive.from.value = "the start";
  }

  // A scene of the page, as everybody gets it.
  place({ family, seed, robot }) {
    const { drive } = this;
    [drive.robot.value, drive.tier.value, drive.disturbance.value, drive.from.value] = [robot, "lagged", "none", "the start"];
    picks.restore({ family, seed });
  }

  open(k) {
    this.place(this.challenges[k]);
    this.again();
  }

  again() {
    this.drive.from.value = "the start";
    this.start();
  }

  draw(keys) {
    this.place(this.challenges[0]);
    this.drive.editor.take("path", keys, true);
  }

  put(keys) {
    const { drive, drive: { hand }, replay } = this;
    if (hand) {
      drive.endHand();
      replay.takeOut(hand.actor);
      replay.fit();
    }
    replay.split(null);
    if (!drive.runs.length) drive.go();
    drive.editor.take("disc", keys, true);
  }

  // Who drives beside the hand: a trained network, and controllers.
  rivals() {
    const { drive } = this;
    if (this.replay.actors.some((actor) => actor.told)) return [];
    const able = drive.able();
    return [...new Set([drive.usual(able), ...RIVALS.filter((each) => able.includes(each))])].filter(Boolean).slice(0, 3);
  }

  // One large word in the picture for a moment.
  flash(word) {
    const { view, chosen, step } = this.replay;
    this.banner.textContent = word;
    // not over the robot that it is about
    this.banner.style.top = !chosen || chosen.y[Math.min(step, chosen.y.length - 1)] > view.centre[1] ? "80%" : "20%";
    this.banner.hidden = false;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => { this.banner.hidden = true; }, 900);
  }

  // The hand's first press starts the clock.
  go() {
    if (!this.drive.hand.tape.length && !this.replay.playing) this.flash("Go!");
    this.replay.canvas.focus({ preventScroll: true });
    this.replay.toggle(true);
  }

  clear() {
    clearTimeout(this.timer);
    this.run = this.watched = null;
    this.sent = false;
    this.banner.hidden = this.card.hidden = true;
    this.replay.app.classList.remove("ended");
  }

  close() {
    this.clear();
    this.drive.rest();
    this.tellScene();
    this.replay.canvas.focus({ preventScroll: true });
  }

  // A card in the place of the pad or of the lists, so that it covers nothing.
  say(...parts) {
    const { drive, replay: { app } } = this;
    drive.rest();
    drive.choice.hidden = true;
    app.classList.add("ended");
    if (this.card.hidden) this.pressed = false;
    this.card.replaceChildren(...parts.filter(Boolean));
    this.card.hidden = false;
  }

  over(run) {
    this.run = run;
    this.nth = this.now;
    this.before = this.nth < 0 ? null : this.best[this.key(this.nth)]; // the best until now
    this.flash(this.how(run).replace(/ in$| after$|:$/, ""));
    this.tellScene();
    this.tell();
  }

  // The result, large in the picture: the place, who came when, what a better medal needs; again as each of the others ends.
  tell(told = "") {
    const { run, drive, replay } = this;
    if (!run && drive.drives && !drive.hand.tape.length) this.watch(); // what the medals need is known
    if (!run) return;
    const steps = ({ x }) => x.length - 1;
    const friend = replay.actors.find(({ policy }) => policy === FRIEND);
    const field = replay.actors.filter((actor) => !actor.ghost);
    const others = field.filter(({ policy }) => policy !== KEYBOARD);
    const rivals = others.filter((actor) => actor !== friend); // medals are won against these
    const arrived = (actor) => actor.outcome === "success";
    const there = others.filter(arrived);
    const settled = others.every((actor) => actor.outcome || steps(actor) > steps(run.actor));
    const faster = there.filter((each) => replay.rank(each) < replay.rank(run.actor));
    const place = arrived(run.actor) && settled ? faster.length : -1;
    const medal = !rivals.length || place < 0 ? "" : MEDALS[faster.some((each) => each !== friend) ? this.limits.findIndex((each) => replay.rank(run.actor) <= each) : 0] || "";
    const eased = easedBy(run);
    const best = this.nth < 0 ? "" : this.record(run, eased);
    if (place >= 0 && !eased) this.keep(steps(run.actor) * DT, medal);
    const order = replay.ranked(field);
    const shown = order.length > 6 ? order.filter((actor, k) => k < 4 || [run.actor, friend].includes(actor)) : order;
    const rows = shown.map((actor) => el("li", { class: actor === run.actor ? "mine" : "" }, el("span", {}, actor === run.actor ? "you" : actor.label.replace(/ \(.*\)/, "")), el("span", {}, arrived(actor) ? replay.result(actor) : (OUTCOMES[actor.outcome] || "still driving").replace("ran ", ""))));
    const next = this.nth < 0 ? this.due : this.nth + 1;
    const forward = next < this.challenges.length && this.nth >= 0 && medal === "gold" ? "go" : null;
    this.say(this.ended(run, this.how(run)),
      ...(place < 0 || !rivals.length ? [] : [el("p", { class: medal ? `medal ${medal}` : "" }, `${medal ? medal[0].toUpperCase() + medal.slice(1) : "No"} medal`),
        el("p", {}, `${["1st", "2nd", "3rd"][place] || `${place + 1}th`} of ${others.length + 1}${medal && medal !== "gold" ? `, within the limit for ${medal}` : there.some((each) => steps(each) === steps(run.actor)) ? ", a tie" : ""}`)]),
      this.why(run) ? el("p", { class: "needed" }, this.why(run)) : null,
      eased ? el("p", { class: "needed" }, `Driven ${eased}${this.nth < 0 ? "." : ": this does not count as a best time."}`) : null,
      best ? el("p", { class: "needed" }, best) : null,
      others.length ? el("ol", { class: "order" }, rows, shown.length < order.length ? el("li", {}, el("span", {}, `and ${order.length - shown.length} others`), el("span")) : null) : null, friend ? el("p", { class: "needed" }, this.beside(run.actor, friend)) : null, this.rule ? el("p", { class: "needed" }, this.rule) : null,
      el("div", { class: "files" }, button(coarse() ? "Try again" : "Try again (R)", () => this.again(), { class: forward ? null : "go" }), next < this.challenges.length ? button(this.nth < 0 ? `Challenge ${next + 1}: ${this.challenges[next].name}` : "Next challenge", () => this.open(next), { class: forward }) : null,
        button("Copy a link to race this run", async () => {
          this.tell(await drive.share.link());
          this.card.lastElementChild.scrollIntoView({ block: "nearest" }); // on a phone it lies below
        })), button("×", () => this.close(), { class: "shut", "aria-label": "close" }), told ? el("p", { class: "note" }, told) : null);
  }

  // One's best time of the challenge, beside this one.
  record({ actor }, eased) {
    const { before } = this;
    const time = (actor.x.length - 1) * DT;
    const counts = actor.outcome === "success" && !eased;
    if (!before) return counts ? "Your first finish, and your best time so far." : "";
    return counts && time < before.time ? `A new best: before it was ${before.time.toFixed(2)}\u00a0s.` : `Your best: ${before.time.toFixed(2)}\u00a0s.`;
  }

  // One's own run beside that of a friend, in a sentence.
  beside(mine, friend) {
    const arrived = [mine, friend].map(({ outcome }) => outcome === "success");
    const who = friend.own ? "last run" : "friend";
    const [gap, last] = [friend.x.length - mine.x.length, friend.x.length - 1].map((steps) => `${Math.abs(steps * DT).toFixed(2)}\u00a0s`);
    if (!friend.outcome) return `Your ${who} is still on its way.`;
    if (!arrived[1]) return `Your ${who} did not arrive${arrived[0] ? ": you win" : " either"}.`;
    if (!arrived[0]) return `Your ${who} arrived in ${last}.`;
    if (friend.x.length === mine.x.length) return `You and your ${who} took the same time.`;
    return friend.x.length > mine.x.length ? `You beat your ${who} by ${gap}.` : `Your ${who} was ${gap} faster.`;
  }

  // How a run by hand ended, and its time: the one large number of a card.
  ended({ actor, tape }, how) {
    return el("strong", { class: actor.outcome === "success" ? "" : "bad" }, el("small", {}, `${how} `), `${(tape.length * DT).toFixed(2)}\u00a0s`);
  }

  // The best time of a challenge is kept.
  keep(time, medal) {
    const { nth, best } = this;
    if (nth < 0) return;
    const before = best[this.key(nth)];
    if (before && (time > before.time || (time === before.time && (before.medal || !medal)))) return;
    try {
      localStorage.setItem(BEST, JSON.stringify({ ...best, [this.key(nth)]: { time, medal } }));
      this.list();
    } catch { /* a browser that keeps nothing */ }
  }

  // A friend's run came by a link.
  challenged(run) {
    this.drive.replay.choose(run.actor);
    while (run.pending) this.drive.pump(1); // who is looked at goes first
    const [eased, { own }] = [easedBy(run), this.replay.world];
    const who = run.actor.own ? "last run" : "friend";
    this.say(this.ended(run, `${run.actor.own ? "You" : "A friend"} ${(ENDED[run.actor.outcome] || "drove for").toLowerCase()}`), eased ? el("p", {}, `driven ${eased}`) : null, own ? el("p", {}, `with ${things(own)} placed in the way`) : null, el("p", { class: "asks" }, ["success", ""].includes(run.actor.outcome) ? "Can you do better?" : "Can you arrive?"),
      el("div", { class: "files" }, button(`Race your ${who}${coarse() ? "" : " (R)"}`, () => this.again(), { class: "go" }), button("watch first", () => {
        this.close();
        this.watched = run;
        this.replay.toggle(true);
      })));
  }

  // A friend's run was watched to its end: it can still be raced.
  back() {
    if (this.watched && this.replay.step >= this.replay.last) this.challenged(this.watched);
  }

  // A scene came by a link; what is over is shown from its start.
  received() {
    const { replay } = this;
    this.sent = true;
    if (!still() && replay.step >= replay.last) {
      replay.seek(0);
      replay.toggle(true);
    }
    this.tellScene();
  }
}
