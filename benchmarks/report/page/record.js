// Records the picture as a film: WebM, as the browser makes it.

const FILM = { seconds: 8, rate: 12, bits: 2.4e6, width: 960 }; // at most 3 MB

// The panes as they are on the screen, on paper.
function framed(film, { board, canvas, beside }) {
  const [whole, context] = [board.getBoundingClientRect(), film.getContext("2d")];
  context.fillStyle = ink("--paper");
  context.fillRect(0, 0, film.width, film.height);
  const factor = film.width / whole.width;
  for (const pane of [canvas, beside]) {
    if (pane.hidden) continue;
    const { left, top, width, height } = pane.getBoundingClientRect();
    context.drawImage(pane, factor * (left - whole.left), factor * (top - whole.top), factor * width, factor * height);
  }
}

function recordButton(replay) {
  let recorder = null;
  const button = el("button", { type: "button", class: "stepwise record", title: `a film of ${FILM.seconds} s`, on: { click: () => (recorder ? recorder.stop() : begin()) } }, "record");
  const begin = () => {
    const { width, height } = replay.board.getBoundingClientRect();
    const film = el("canvas", { width: Math.min(Math.round(width), FILM.width), height: Math.round(Math.min(1, FILM.width / width) * height) });
    framed(film, replay);
    const parts = [];
    recorder = new MediaRecorder(film.captureStream(FILM.rate), { mimeType: "video/webm", videoBitsPerSecond: FILM.bits });
    const [paints, ends] = [setInterval(() => framed(film, replay), 1000 / FILM.rate), setTimeout(() => recorder.stop(), 1000 * FILM.seconds)];
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onstop = () => {
      clearInterval(paints);
      clearTimeout(ends);
      [recorder, button.textContent] = [null, "record"];
      downloaded(new Blob(parts, { type: "video/webm" }), "wayfield.webm");
    };
    recorder.start();
    button.textContent = "● stop recording";
    replay.toggle(true);
  };
  button.hidden = typeof MediaRecorder === "undefined" || !MediaRecorder.isTypeSupported("video/webm");
  return button;
}
