// Records the picture as a film: WebM, as the browser makes it.

const FILM = { seconds: 20, rate: 12, bits: 1.2e6, width: 960, rests: 10, name: "wayfield.webm" }; // at most 3 MB

// The panes as they are on the screen, on paper.
function framed(film, { board, canvas, beside, chosen, other, actors }) {
  const [whole, context] = [board.getBoundingClientRect(), film.getContext("2d")];
  context.fillStyle = ink("--paper");
  context.fillRect(0, 0, film.width, film.height);
  const factor = film.width / whole.width;
  [context.font, context.lineWidth, context.strokeStyle, context.fillStyle] = ["600 14px system-ui, sans-serif", 4, ink("--paper"), ink("--ink")];
  for (const [pane, actor] of [[canvas, chosen], [beside, other]]) {
    if (pane.hidden) continue;
    const { left, top, width, height } = pane.getBoundingClientRect();
    context.drawImage(pane, factor * (left - whole.left), factor * (top - whole.top), factor * width, factor * height);
    if (actor && (other || actors.length === 1)) for (const how of ["strokeText", "fillText"]) context[how](actor.label, factor * (left - whole.left) + 10, factor * (top - whole.top) + 22); // elsewhere names are in the picture
  }
}

// Until it is stopped, or the run is over. The replay waits for the film: however slow the machine, none of its moments is lost.
function recordButton(replay) {
  const button = el("button", { type: "button", class: "stepwise record", title: `a film of at most ${FILM.seconds} s`, on: { click: () => (!recorder ? begin() : armed ? ended() : recorder.stop()) } }, "record");
  let [recorder, rest, armed] = [null, 0, false]; // armed: it begins with the first press of a race
  const ended = () => {
    clearInterval(rest);
    [recorder, replay.filmed, button.textContent] = [null, null, "record"];
    button.removeAttribute("aria-label");
    button.classList.remove("on");
  };
  const begin = () => {
    const { width, height } = replay.board.getBoundingClientRect();
    const film = el("canvas", { width: Math.min(Math.round(width), FILM.width), height: Math.round(Math.min(1, FILM.width / width) * height) });
    framed(film, replay);
    const parts = [];
    let [count, at, rests] = [0, 0, 0];
    const frame = () => {
      if (recorder.state !== "recording" || performance.now() - at < 1000 / FILM.rate - 5) return;
      at = performance.now();
      framed(film, replay);
      if (++count > FILM.seconds * FILM.rate) recorder.stop();
    };
    recorder = new MediaRecorder(film.captureStream(), { mimeType: "video/webm", videoBitsPerSecond: FILM.bits });
    replay.filmed = frame;
    rest = setInterval(() => { // its last picture stands for a moment
      if (armed && replay.playing) {
        armed = false;
        recorder.start();
      }
      if (armed) return;
      rests = replay.playing ? 0 : rests + 1;
      if (rests) frame();
      if (rests > FILM.rests) recorder.stop();
    }, 1000 / FILM.rate);
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onstop = () => {
      ended();
      downloaded(new Blob(parts, { type: "video/webm" }), FILM.name);
      replay.saved(`The film was saved as ${FILM.name}, where your browser keeps downloads.${count > FILM.seconds * FILM.rate ? ` It holds ${FILM.seconds} s, and no more.` : ""}`);
    };
    armed = replay.poised();
    if (!armed) recorder.start();
    button.textContent = "■ stop";
    button.setAttribute("aria-label", "stop recording");
    button.classList.add("on");
    if (armed) replay.saved("The film begins with your first press.");
    else replay.toggle(true);
  };
  button.hidden = typeof MediaRecorder === "undefined" || !MediaRecorder.isTypeSupported("video/webm");
  return button;
}
