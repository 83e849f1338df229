"use strict";
// The page: camera, time, switches, curves.
const SIDES = [[0.82, 0.86, 0.9, 1], [1, 0.64, 0.23, 1], [0.36, 0.74, 1, 1]];
const TAKES = [[0.36, 0.74, 1, 1], [1, 0.64, 0.23, 1], [0.5, 0.85, 0.5, 1], [0.9, 0.55, 0.8, 1], [0.95, 0.9, 0.4, 1]];
const AXES = ["#ff7b72", "#7ee787", "#79b8ff"];
const css = (c) => `rgb(${c.slice(0, 3).map((v) => Math.round(255 * v))})`;

class Viewer extends Orbit {
  // In `root`, an element with the parts of component.html; `page` where it is all that the page has.
  constructor(root, data, page) {
    super();
    this.root = root; this.page = page;
    this.takes = data.takes.map((packed) => new Take(packed));
    this.duration = Math.max(...this.takes.map((take) => take.duration));
    this.fps = Math.max(...this.takes.map((take) => take.fps));
    this.seconds = 0; this.playing = this.duration > 0; this.speed = 1; this.cost = 0;
    this.painter = new Painter(this.$("stage"), () => { this.dirty = true; });
    this.takes.forEach((take) => this.painter.prepare(take));
    const meshes = this.takes.some((take) => take.meshes.length);
    this.$("mesh").parentElement.hidden = !meshes; this.$("bones").parentElement.hidden = !meshes;
    const feet = this.takes.some((take) => take.feet);
    this.$("contacts").parentElement.hidden = !feet; this.$("strip").hidden = !feet || !this.playing;
    this.$("apart").checked = data.apart; this.$("apart").parentElement.hidden = this.takes.length < 2;
    this.$("scrub").max = Math.round(this.duration * this.fps);
    for (const id of ["play", "back", "on", "scrub"]) this.$(id).disabled = !this.playing;
    if (!this.playing) this.$("play").textContent = "Play";
    this.measure(); this.arrange(); this.reset(); this.label(); this.listen();
    new ResizeObserver(() => { this.dirty = true; }).observe(this.$("stage"));
    // Within a longer page nothing is drawn while it is out of sight, and nothing moves where that is not wanted.
    this.inSight = true;
    new IntersectionObserver((seen) => { this.inSight = seen[seen.length - 1].isIntersecting; }).observe(root);
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) this.play(false);
    this.dirty = true; this.last = performance.now();
    requestAnimationFrame((now) => this.tick(now));
  }
  $(part) { return this.root.querySelector(`[data-part=${part}]`); }
  measure() {
    this.height = 0; this.wide = 0; let travel = 0;
    for (const take of this.takes) {
      const boxes = [0, take.frames >> 1, take.frames - 1].map((t) => this.box(take, t)).filter((b) => b);
      if (!boxes.length) { take.start = [0, 0, 0]; continue; }
      const first = boxes[0], size = Math.max(...boxes.map((b) => Math.max(...sub(b[1], b[0]))));
      this.height = Math.max(this.height, size);
      this.wide = Math.max(this.wide, ...boxes.map((b) => b[1][0] - b[0][0]));
      for (const b of boxes) travel = Math.max(travel, Math.hypot(...sub(b[0], first[0])));
    }
    this.height = this.height || 1;
    this.$("follow").checked = travel > this.height;
  }
  box(take, t) {
    let low = null, high = null;
    for (let j = 0; j < take.count; j++) {
      const p = take.place(t, j);
      if (!p) continue;
      low = low ? low.map((v, i) => Math.min(v, p[i])) : p; high = high ? high.map((v, i) => Math.max(v, p[i])) : p;
    }
    const skin = take.margin;
    return low && [low.map((v, i) => v - (skin ? skin[0][i] : 0)), high.map((v, i) => v + (skin ? skin[1][i] : 0))];
  }
  arrange() {
    const apart = this.$("apart").checked, step = Math.max(1.1 * this.wide, 0.8 * this.height);
    this.takes.forEach((take, i) => { take.shift = [apart ? (i - (this.takes.length - 1) / 2) * step : 0, 0, 0]; });
    this.dirty = true;
  }
  middle() {
    const boxes = this.takes.map((take) => this.box(take, take.frame(this.seconds))).filter((b) => b);
    if (!boxes.length) return this.centre || [0, 0, 0];
    return [0, 1, 2].map((i) => (Math.min(...boxes.map((b) => b[0][i])) + Math.max(...boxes.map((b) => b[1][i]))) / 2);
  }
  reset() {
    this.centre = this.middle(); this.pan = [0, 0, 0]; this.yaw = -1.1; this.pitch = 0.2;
    const aspect = this.$("stage").clientWidth / (this.$("stage").clientHeight || 1);
    const across = this.$("apart").checked ? this.takes.length * 0.8 : 1;
    this.distance = 1.9 * this.height * Math.max(1, across / Math.max(aspect, 0.3));
    if (this.$("apart").checked) this.yaw = -Math.PI / 2;
    this.dirty = true;
  }
  label() {
    this.$("legend").replaceChildren(...this.takes.map((take, i) => {
      const line = document.createElement("div"), dot = document.createElement("i");
      if (this.takes.length > 1) { dot.style.background = css(TAKES[i % TAKES.length]); line.append(dot); }
      line.append(take.name); return line;
    }));
    this.takes.forEach((take, i) => this.$("take").append(new Option(take.name, i)));
    this.$("take").hidden = this.takes.length < 2;
    this.listJoints();
  }
  listJoints() {
    const take = this.takes[this.$("take").value || 0];
    this.$("joint").replaceChildren(...take.names.map((name, j) => new Option(name, j)));
    // A root bone often stands still: the first joint that moves tells more.
    const away = (j) => [1, 2, 3].some((k) => {
      const a = take.place(0, j), b = take.place(Math.floor(k * (take.frames - 1) / 3), j);
      return a && b && Math.hypot(...sub(a, b)) > 0.01 * this.height;
    });
    this.$("joint").value = Math.max(0, take.names.findIndex((_, j) => away(j)));
    this.$("quantity").hidden = !take.quats;
    if (!take.quats) this.$("quantity").value = "place";
  }
  listen() {
    const redraw = () => { this.dirty = true; };
    for (const id of ["mesh", "bones", "contacts", "joint", "quantity"]) this.$(id).addEventListener("change", redraw);
    this.$("apart").addEventListener("change", () => { this.arrange(); this.reset(); });
    this.$("follow").addEventListener("change", () => { this.pan = [0, 0, 0]; redraw(); });
    this.$("curves").addEventListener("change", () => { this.$("plot").hidden = !this.$("curves").checked; redraw(); });
    this.$("take").addEventListener("change", () => { this.listJoints(); redraw(); });
    this.$("reset").addEventListener("click", () => this.reset());
    this.$("play").addEventListener("click", () => this.play(!this.playing));
    this.$("back").addEventListener("click", () => this.step(-1)); this.$("on").addEventListener("click", () => this.step(1));
    this.$("speed").addEventListener("change", () => { this.speed = Number(this.$("speed").value); });
    this.$("scrub").addEventListener("input", () => { this.play(false); this.go(this.$("scrub").value / this.fps); });
    (this.page ? document : this.root).addEventListener("keydown", (event) => {
      if (/INPUT|SELECT|BUTTON/.test(event.target.tagName)) return;
      const keys = { " ": () => this.play(!this.playing), ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1) };
      if (keys[event.key]) { keys[event.key](); event.preventDefault(); event.stopPropagation(); }
    });
    const scrub = (event) => {
      if (!event.buttons) return;
      const box = this.$("graph").getBoundingClientRect();
      this.play(false); this.go(clamp((event.clientX - box.left) / box.width, 0, 1) * this.duration);
    };
    this.$("graph").addEventListener("pointerdown", scrub); this.$("graph").addEventListener("pointermove", scrub);
    this.listenCamera(this.$("stage"));
  }
  play(on) {
    if (on && this.seconds >= this.duration) this.seconds = 0;
    this.playing = on && this.duration > 0; this.$("play").textContent = this.playing ? "Pause" : "Play"; this.dirty = true;
  }
  step(count) { this.play(false); this.go((Math.round(this.seconds * this.fps) + count) / this.fps); }
  go(seconds) { this.seconds = clamp(seconds, 0, this.duration); this.dirty = true; }
  tick(now) {
    const passed = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    if (this.playing && this.inSight) {
      let next = this.seconds + this.speed * passed;
      if (next > this.duration) { if (this.$("loop").checked) next %= this.duration; else { next = this.duration; this.play(false); } }
      this.go(next);
    }
    if (this.dirty && this.inSight) {
      this.dirty = false;
      const start = performance.now();
      this.draw();
      const cost = performance.now() - start;
      this.cost = this.cost ? 0.9 * this.cost + 0.1 * cost : cost;
      this.root.dataset.state = "ready"; this.root.dataset.ms = this.cost.toFixed(2);
    }
    requestAnimationFrame((time) => this.tick(time));
  }
  draw() {
    const stage = this.$("stage"), ratio = Math.min(2, window.devicePixelRatio || 1);
    const size = [stage.clientWidth, stage.clientHeight].map((v) => Math.max(1, Math.round(v * ratio)));
    if (stage.width !== size[0] || stage.height !== size[1]) [stage.width, stage.height] = size;
    if (this.$("follow").checked) this.centre = this.middle();
    const target = this.centre.map((v, i) => v + this.pan[i]), { view, eye } = this.look(target, size);
    const painter = this.painter, lines = [], points = [];
    painter.begin(view, eye, size, 0.021 * this.distance);
    const gl = painter.gl, feet = [];
    // The floor hides nothing.
    gl.depthMask(false); painter.drawLines(this.grid(target), ratio); gl.depthMask(true);
    this.takes.forEach((take, i) => {
      const t = take.frame(this.seconds), mesh = take.meshes.length && this.$("mesh").checked;
      if (mesh) painter.drawMeshes(take, t);
      if (!mesh || this.$("bones").checked) this.figure(take, t, i, lines, points);
      if (take.feet && this.$("contacts").checked) for (let k = 0; k < 4; k++) {
        const p = take.foot(t, k);
        if (p) feet.push([p, SIDES[k < 2 ? 1 : 2].slice(0, 3).concat(0.85), 15]);
      }
    });
    if (this.$("mesh").checked && this.$("bones").checked) gl.clear(gl.DEPTH_BUFFER_BIT);
    painter.drawLines(lines, 4 * ratio); painter.drawPoints(points, ratio);
    // Where feet stand is seen through them.
    gl.disable(gl.DEPTH_TEST); painter.drawPoints(feet, ratio); gl.enable(gl.DEPTH_TEST);
    this.drawTime();
  }
  figure(take, t, i, lines, points) {
    const places = take.names.map((_, j) => take.place(t, j)), many = this.takes.length > 1;
    const colour = (j) => (many ? TAKES[i % TAKES.length] : SIDES[take.sides[j]]);
    for (const [a, b] of take.edges) if (places[a] && places[b]) lines.push([places[a], places[b], colour(b)]);
    places.forEach((p, j) => { if (p) points.push([p, colour(j), take.edges.length ? 6 : 8]); });
  }
  drawTime() {
    const frame = Math.round(this.seconds * this.fps);
    this.$("scrub").value = frame;
    this.$("time").textContent = `${this.seconds.toFixed(2)} / ${this.duration.toFixed(2)} s, frame ${frame + 1} of ${Number(this.$("scrub").max) + 1}`;
    if (!this.$("strip").hidden) this.drawStrip();
    if (!this.$("plot").hidden) this.drawCurves();
  }
  flat(canvas) {
    const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio);
    const c = canvas.getContext("2d");
    c.scale(ratio, ratio);
    return [c, w, h];
  }
  drawStrip() {
    const [c, w, h] = this.flat(this.$("strip")), shown = this.takes.filter((take) => take.feet), row = h / (2 * shown.length);
    const whole = this.duration || 1;
    shown.forEach((take, i) => {
      for (let side = 0; side < 2; side++) {
        c.fillStyle = css(SIDES[side + 1]);
        for (let t = 0, from = -1; t <= take.frames; t++) {
          const on = t < take.frames && (take.feet.stands[4 * t + 2 * side] || take.feet.stands[4 * t + 2 * side + 1]);
          if (on && from < 0) from = t;
          if (!on && from >= 0) { c.fillRect(from / take.fps / whole * w, (2 * i + side) * row, Math.max(1, (t - from) / take.fps / whole * w), row - 1); from = -1; }
        }
      }
    });
    c.fillStyle = "#fff"; c.fillRect(clamp(this.seconds / whole * w, 0, w - 1), 0, 1, h);
  }
  drawCurves() {
    const [c, w, h] = this.flat(this.$("graph")), take = this.takes[this.$("take").value || 0], j = Number(this.$("joint").value);
    const shift = take.shift;
    const at = this.$("quantity").value === "turn" && take.quats ? (t) => take.turn(t, j) : (t) => { const p = take.place(t, j); return p && sub(p, shift); };
    const every = Math.max(1, Math.ceil(take.frames / (2 * w))), values = [];
    for (let t = 0; t < take.frames; t += every) values.push([t, at(t)]);
    const all = values.flatMap(([, v]) => v || []);
    let low = all.reduce((a, b) => Math.min(a, b), Infinity), high = all.reduce((a, b) => Math.max(a, b), -Infinity);
    if (!(high - low > 1e-3)) { low -= 0.5; high += 0.5; }
    const y = (v) => h - 6 - (v - low) / (high - low) * (h - 12), whole = this.duration || 1;
    AXES.forEach((colour, i) => {
      c.strokeStyle = colour; c.lineWidth = 1.5; c.beginPath();
      let on = false;
      for (const [t, v] of values) { if (!v) { on = false; continue; } const x = t / take.fps / whole * w; if (on) c.lineTo(x, y(v[i])); else c.moveTo(x, y(v[i])); on = true; }
      c.stroke();
    });
    c.fillStyle = "#a4adb6"; c.font = "11px system-ui"; c.fillText(high.toFixed(2), 2, 12); c.fillText(low.toFixed(2), 2, h - 3);
    c.fillStyle = "#fff"; c.fillRect(this.seconds / whole * w, 0, 1, h);
    const now = at(take.frame(this.seconds));
    this.$("values").replaceChildren(...AXES.map((colour, i) => {
      const text = document.createElement("span");
      text.style.color = colour; text.textContent = `${"xyz"[i]} ${now ? (Math.round(1000 * now[i]) / 1000 + 0).toFixed(3) : "missing"}`;
      return text;
    }));
  }
}

for (const root of document.querySelectorAll(".viewer")) {
  const data = root.querySelector("script[type='application/json']");
  try {
    root.viewer = new Viewer(root, JSON.parse(data.textContent), root.parentElement === document.body);
  } catch (error) {
    const message = root.querySelector("[data-part=message]");
    message.hidden = false; message.textContent = error.message;
    root.dataset.state = "failed";
  }
}
