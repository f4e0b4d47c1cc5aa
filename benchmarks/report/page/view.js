// Metres to pixels: fits a world into a canvas, zooms, moves, follows.

const NEAR = 64; // px of a metre, on a small picture of who is driven by hand

class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.bounds = [-1, -1, 1, 1];
    this.zoom = 1;
    this.least = 0.3; // zoom
    this.middle = null; // m; null: that of the bounds
    this.stale = true; // the page is only asked for sizes when they have changed: an answer makes it lay itself out
    new ResizeObserver(() => { this.stale = true; }).observe(canvas);
    this.measure();
  }

  measure() {
    if (!this.stale) return;
    this.stale = false;
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    const [w, h] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w;
      this.canvas.height = h;
    }
    this.ratio = ratio;
  }

  // From far enough away, the whole is seen too.
  fit({ shown, whole }) {
    const side = ([x0, y0, x1, y1]) => Math.max(x1 - x0, y1 - y0, 0.1);
    this.bounds = shown;
    this.least = 0.3 * side(shown) / side(whole);
    this.zoom = 1;
    this.middle = null;
  }

  // Shows a place (m) too, with a margin around it: from farther away where it has left the picture.
  takeIn([x, y], margin) {
    const [cx, cy] = this.centre;
    const [a, b] = [this.width / 2 / this.pixels, this.height / 2 / this.pixels];
    if (!this.width || (Math.abs(x - cx) <= a - margin && Math.abs(y - cy) <= b - margin)) return;
    const [x0, y0, x1, y1] = this.bounds;
    this.bounds = [Math.min(x0, x - margin), Math.min(y0, y - margin), Math.max(x1, x + margin), Math.max(y1, y + margin)];
    [this.zoom, this.middle] = [1, null];
  }

  // Nearer to a place where the whole is small, some way towards another, and within the bounds.
  lead([x, y], goal, near = NEAR) {
    const [x0, y0, x1, y1] = this.bounds;
    this.zoom = 1;
    if (this.pixels >= near) { this.middle = null; return; }
    this.zoom = near / this.pixels;
    const half = [this.width, this.height].map((side) => side / 2 / near);
    const [dx, dy] = goal ? [goal[0] - x, goal[1] - y] : [0, 0];
    const share = Math.min(1, (0.5 * Math.min(...half)) / Math.max(Math.hypot(dx, dy), 0.01));
    const within = (at, low, high, k) => (high - low < 2 * half[k] ? (low + high) / 2 : Math.min(Math.max(at, low + half[k]), high - half[k]));
    this.middle = [within(x + share * dx, x0, x1, 0), within(y + share * dy, y0, y1, 1)];
  }

  get pixels() { // of a metre
    const [x0, y0, x1, y1] = this.bounds;
    return this.zoom * Math.min(this.width / Math.max(x1 - x0, 0.1), this.height / Math.max(y1 - y0, 0.1));
  }

  get centre() {
    const [x0, y0, x1, y1] = this.bounds;
    return this.middle || [(x0 + x1) / 2, (y0 + y1) / 2];
  }

  // The context in metres, y up.
  begin() {
    const { context, ratio, pixels } = this;
    const [cx, cy] = this.centre;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    const k = ratio * pixels;
    context.setTransform(k, 0, 0, -k, ratio * this.width / 2 - k * cx, ratio * this.height / 2 + k * cy);
    context.lineJoin = "round";
    context.lineCap = "round";
    return context;
  }

  // A faint word in the middle.
  write(text) {
    const { context, ratio } = this;
    context.save();
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    [context.font, context.textAlign, context.fillStyle] = ["600 22px system-ui, sans-serif", "center", ink("--faint")];
    context.fillText(text, this.width / 2, this.height / 2);
    context.restore();
  }

  metres(event) {
    const box = this.canvas.getBoundingClientRect();
    const [cx, cy] = this.centre;
    return [cx + (event.clientX - box.left - this.width / 2) / this.pixels, cy - (event.clientY - box.top - this.height / 2) / this.pixels];
  }

  // The nearest place in the picture.
  within([x, y]) {
    const [cx, cy] = this.centre;
    const [a, b] = [this.width, this.height].map((side) => Math.max(side / 2 - 12, 0) / this.pixels);
    return [Math.min(Math.max(x, cx - a), cx + a), Math.min(Math.max(y, cy - b), cy + b)];
  }

  zoomBy(factor, at) {
    const [cx, cy] = this.centre;
    const zoom = Math.min(Math.max(this.zoom * factor, this.least), 40);
    const share = 1 - this.zoom / zoom;
    const [x, y] = at || [cx, cy];
    this.middle = [cx + share * (x - cx), cy + share * (y - cy)];
    this.zoom = zoom;
  }

  moveBy(dx, dy) {
    const [cx, cy] = this.centre;
    this.middle = [cx - dx / this.pixels, cy + dy / this.pixels];
  }
}
