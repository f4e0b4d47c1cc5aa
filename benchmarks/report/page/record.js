// Records the picture as a film: WebM, as the browser makes it.

const FILM = { seconds: 20, rate: 12, bits: 1.2e6, width: 960, rests: 10, name: "wayfield.webm" }; // at most 3 MB
const [BEHIND, PATIENCE, LATEST] = [6, 1500, 5000]; // pictures that the browser's encoder may be late, ms that one waits for it, and at the end

// How many pictures there are in a WebM file: its blocks.
function picturesIn(bytes) {
  let [at, count] = [0, 0];
  const number = (keep) => { // its leading zeros tell how long it is
    const length = Math.clz32(bytes[at]) - 23;
    let value = keep ? bytes[at] : bytes[at] & (0xff >> length);
    for (let k = 1; k < length; k++) value = 256 * value + bytes[at + k];
    at += length;
    return value;
  };
  while (at < bytes.length) {
    const [id, size] = [number(true), number(false)];
    if (id === 0xa3 || id === 0xa0) count += 1;
    if (id !== 0x18538067 && id !== 0x1f43b675) at += size; // but for what holds the blocks
  }
  return count;
}

// The panes as they are on the screen, on paper, with who drives, the clock and how it ended.
function framed(film, { board, canvas, beside, chosen, other, actors, step }) {
  const [whole, context] = [board.getBoundingClientRect(), film.getContext("2d")];
  context.fillStyle = ink("--paper");
  context.fillRect(0, 0, film.width, film.height);
  const factor = film.width / whole.width;
  context.font = "600 14px system-ui, sans-serif";
  const write = (text, x, y) => {
    context.fillStyle = ink("--paper");
    context.fillRect(x - 4, y - 15, context.measureText(text).width + 8, 20);
    context.fillStyle = ink("--ink");
    context.fillText(text, x, y);
  };
  const result = ({ label, outcome, end, x }) => `${label}${outcome && step >= x.length - 1 ? `: ${end || `${OUTCOMES[outcome]}, ${((x.length - 1) * DT).toFixed(2)} s`}` : ""}`;
  for (const [pane, actor] of [[canvas, chosen], [beside, other]]) {
    if (pane.hidden) continue;
    const { left, top, width, height } = pane.getBoundingClientRect();
    context.drawImage(pane, factor * (left - whole.left), factor * (top - whole.top), factor * width, factor * height);
    if (actor && (other || actors.length === 1 || result(actor) !== actor.label)) write(result(actor), factor * (left - whole.left) + 10, factor * (top - whole.top) + 22); // elsewhere names are in the picture
  }
  const clock = `wayfield, ${(step * DT).toFixed(2)} s`;
  write(clock, film.width - 10 - context.measureText(clock).width, film.height - 10); // sentences stand on the left
}

// Whether the picture is not on the screen, or has not been drawn since it came back.
const unseen = ({ board, canvas }) => !board.clientWidth || !canvas.width;

// Until it is stopped, or the run is over. The replay waits for the film: however slow the machine, none of its moments is lost.
function recordButton(replay) {
  const button = el("button", { type: "button", class: "stepwise record", title: `a film of at most ${FILM.seconds} s`, on: { click: () => (!recorder ? begin() : armed ? ended() : stop()) } }, "record");
  const { title } = button;
  let [recorder, rest, armed, stop] = [null, 0, false, null]; // armed: it begins with the first press of a race
  const ended = () => {
    clearInterval(rest);
    [recorder, replay.filmed, button.textContent, button.title] = [null, null, "record", title];
    button.removeAttribute("aria-label");
    button.classList.remove("on");
  };
  const begin = () => {
    const ran = replay.playing;
    let halt = null; // the step from which the replay goes on once the film is there
    if (!replay.races()) replay.seek(0); // a run is filmed from its start
    const { width, height } = replay.board.getBoundingClientRect();
    const film = el("canvas", { width: Math.min(Math.round(width), FILM.width), height: Math.round(Math.min(1, FILM.width / width) * height) });
    framed(film, replay);
    const parts = [];
    let [count, at, rests] = [0, 0, 0];
    let [held, lost, changed, stopped] = [0, 0, 0, 0]; // pictures in the film, those given up, and when (ms)
    const tells = () => {
      const left = replay.races() || (replay.busy && replay.busy()) ? Infinity : ((replay.last - replay.step) * DT) / replay.rate + FILM.rests / FILM.rate;
      [button.textContent, button.title] = [`■ stop, ${Math.max(Math.ceil(Math.min(left, FILM.seconds - count / FILM.rate)), 0)} s left`, "it records as long as the film will be; so many seconds are left"];
    };
    const frame = () => {
      if (recorder.state !== "recording" || unseen(replay) || performance.now() - at < 1000 / FILM.rate - 5) return;
      at = performance.now();
      framed(film, replay);
      tells();
      if (++count > FILM.seconds * FILM.rate) stop();
    };
    recorder = new MediaRecorder(film.captureStream(), { mimeType: "video/webm", videoBitsPerSecond: FILM.bits });
    replay.filmed = frame;
    replay.cut = () => { if (recorder && !armed && !stopped) stop(); };
    replay.holds = () => {
      const now = performance.now();
      if (count - held - lost <= BEHIND) changed = now;
      else if (now - changed > PATIENCE) lost = count - held;
      return unseen(replay) || count - held - lost > BEHIND;
    };
    // the encoder first comes to its end
    stop = () => {
      if (stopped) recorder.stop();
      else if (ran && replay.playing && !replay.races()) halt = replay.step;
      if (!replay.races()) replay.toggle(false);
      button.textContent = "saving";
      [stopped, replay.filmed] = [performance.now(), null];
    };
    rest = setInterval(() => { // its last picture stands for a moment
      if (armed && replay.playing) {
        armed = false;
        recorder.start(100);
      }
      if (armed) return;
      if (stopped) {
        if (count - held - lost <= 1 || performance.now() - stopped > LATEST) recorder.stop();
        return;
      }
      rests = replay.playing ? 0 : rests + 1;
      if (rests) frame();
      if (rests > FILM.rests) stop();
    }, 1000 / FILM.rate);
    const bytes = async () => picturesIn(new Uint8Array(await new Blob(parts).arrayBuffer()));
    recorder.ondataavailable = async (event) => {
      parts.push(event.data);
      held = Math.max(held, await bytes());
    };
    recorder.onstop = async () => {
      ended();
      if (halt === replay.step && halt < replay.last && !replay.races()) replay.toggle(true);
      held = await bytes();
      downloaded(new Blob(parts, { type: "video/webm" }), FILM.name);
      noted(held < 0.5 * count ? `The film has only ${held} of its ${count} pictures, as this computer is too busy: close other programs, and record again.`
        : `The film was saved as ${FILM.name}, where your browser keeps downloads.${count > FILM.seconds * FILM.rate ? ` It holds ${FILM.seconds} s, and no more.` : ""}`, button.getBoundingClientRect());
    };
    armed = replay.poised();
    if (!armed) recorder.start(100);
    tells();
    button.setAttribute("aria-label", "stop recording");
    button.classList.add("on");
    if (armed) noted("The film begins with your first press.", button.getBoundingClientRect());
    else replay.toggle(true);
  };
  button.hidden = typeof MediaRecorder === "undefined" || !MediaRecorder.isTypeSupported("video/webm");
  return button;
}
