"use strict";
// The page: keys, a stick for fingers, a path drawn on the floor; and what is drawn of the figure.
const SIDES = [[0.82, 0.86, 0.9, 1], [1, 0.64, 0.23, 1], [0.36, 0.74, 1, 1]];
const SHADOW = [0.05, 0.055, 0.065, 1], WANTED = [0.5, 0.85, 0.5, 1], PATH = [0.5, 0.85, 0.5, 0.7], TRAIL = [0.64, 0.68, 0.71, 0.6];
const KEYS = { ArrowUp: [0, 1], KeyW: [0, 1], ArrowDown: [0, -1], KeyS: [0, -1], ArrowLeft: [-1, 0], KeyA: [-1, 0], ArrowRight: [1, 0], KeyD: [1, 0] };
const LONGEST = 0.1; // seconds that one picture may take the figure on
const SLOW = 50, COARSEST = 0.5; // frames per second below which fewer pixels are drawn, and the least share of them a side

class Steering extends Orbit {
  constructor(root, packed) {
    super();
    this.root = root;
    this.clips = new Clips(packed); this.figure = new Figure(this.clips, packed.steer);
    const software = drawnInSoftware();
    this.painter = new Painter(this.$("stage"), () => {}, !software);
    this.height = Math.max(...this.clips.places(this.figure.pose()).map((p) => p[2])) || 1;
    this.held = new Set(); this.pad = [0, 0]; this.path = null; this.drawn = []; this.trail = []; this.frames = []; this.cost = 0; this.detail = software ? 0.7 : 1; this.slow = 0;
    this.centre = [...this.figure.place, 0.55 * this.height];
    this.$("speed").max = Math.max(packed.speeds.fast, 0.1); this.$("speed").value = packed.speeds.walk;
    this.fast = packed.speeds.fast;
    this.$("help").textContent = "Arrow keys or W A S D steer, Shift is fastest. Drag to look around.";
    this.reset(); this.listen(); this.pace();
    this.last = performance.now();
    requestAnimationFrame((now) => this.tick(now));
  }
  $(part) { return this.root.querySelector(`[data-part=${part}]`); }
  reset() { this.yaw = -Math.PI / 2; this.pitch = 0.35; this.distance = 3.2 * this.height; this.pan = [0, 0, 0]; }
  pace() { this.$("pace").textContent = `${Number(this.$("speed").value).toFixed(2)} m/s`; }
  listen() {
    const stage = this.$("stage");
    const speed = (on) => (event) => {
      if (event.code === "ShiftLeft" || event.code === "ShiftRight") { this.shift = on; return; }
      if (!(event.code in KEYS) || event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT/.test(event.target.tagName)) return;
      if (on) { this.held.add(event.code); this.leave(); } else this.held.delete(event.code);
      event.preventDefault();
    };
    document.addEventListener("keydown", speed(true)); document.addEventListener("keyup", speed(false));
    window.addEventListener("blur", () => { this.held.clear(); this.shift = false; });
    this.$("speed").addEventListener("input", () => this.pace());
    this.$("speed").addEventListener("change", () => stage.focus());
    this.$("reset").addEventListener("click", () => { this.reset(); stage.focus(); });
    this.$("draw").addEventListener("click", () => { this.drawing(this.$("draw").getAttribute("aria-pressed") !== "true"); stage.focus(); });
    this.listenPad(this.$("pad"));
    // Before the camera's listeners: a path is drawn instead of turning the view.
    for (const name of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) stage.addEventListener(name, (e) => this.sketch(name, e));
    this.listenCamera(stage);
    stage.focus({ preventScroll: true });
  }
  listenPad(pad) {
    const knob = pad.firstElementChild;
    const to = (x, y) => { const n = Math.max(1, Math.hypot(x, y)); this.pad = [x / n, y / n]; knob.style.translate = `${34 * this.pad[0]}px ${-34 * this.pad[1]}px`; };
    const at = (e) => { const box = pad.getBoundingClientRect(); to((e.clientX - box.left) / box.width * 2 - 1, 1 - (e.clientY - box.top) / box.height * 2); };
    pad.addEventListener("pointerdown", (e) => { pad.setPointerCapture(e.pointerId); this.leave(); at(e); e.preventDefault(); });
    pad.addEventListener("pointermove", (e) => { if (pad.hasPointerCapture(e.pointerId)) at(e); });
    for (const name of ["pointerup", "pointercancel"]) pad.addEventListener(name, () => to(0, 0));
  }
  // Steering by hand ends a path.
  leave() { this.path = null; this.drawn = []; this.drawing(false); }
  drawing(on) { this.$("draw").setAttribute("aria-pressed", on); this.root.classList.toggle("drawing", on); this.sketching = false; if (on) { this.path = null; this.drawn = []; } }
  sketch(name, event) {
    if (!this.root.classList.contains("drawing")) return;
    event.stopImmediatePropagation(); event.preventDefault();
    if (name === "pointerdown") { this.sketching = true; this.drawn = []; this.$("stage").setPointerCapture(event.pointerId); }
    if (!this.sketching) return;
    const point = this.floorAt(event), last = this.drawn[this.drawn.length - 1];
    if (point && (!last || Math.hypot(point[0] - last[0], point[1] - last[1]) > 0.08)) this.drawn.push(point);
    if (name === "pointerup" || name === "pointercancel") {
      if (this.drawn.length > 1) this.walkAlong(this.drawn);
      this.root.classList.remove("drawing"); this.$("draw").setAttribute("aria-pressed", false); this.sketching = false;
    }
  }
  // The figure goes to the path's start, then along it; its corners are rounded.
  walkAlong(points) {
    const p = this.figure.place, first = points[0], gap = Math.hypot(first[0] - p[0], first[1] - p[1]), way = [];
    for (let k = 0, n = Math.ceil(gap / 0.2); k < n; k++) way.push([p[0] + k / n * (first[0] - p[0]), p[1] + k / n * (first[1] - p[1])]);
    let smooth = way.concat(points);
    for (let round = 0; round < 3; round++) smooth = smooth.map((q, i) => i && i < smooth.length - 1 ? [0, 1].map((c) => (smooth[i - 1][c] + 2 * q[c] + smooth[i + 1][c]) / 4) : q);
    this.path = new GroundPath(smooth); this.drawn = smooth;
  }
  // Where the ray through a pointer meets the floor; null above the horizon.
  floorAt(event) {
    const box = this.$("stage").getBoundingClientRect(), { eye, target } = this.camera;
    const z = norm(sub(eye, target)), x = norm(cross([0, 0, 1], z)), y = cross(z, x), f = Math.tan(FOV / 2);
    const u = ((event.clientX - box.left) / box.width * 2 - 1) * f * box.width / box.height, v = (1 - (event.clientY - box.top) / box.height * 2) * f;
    const way = [0, 1, 2].map((i) => u * x[i] + v * y[i] - z[i]), t = -eye[2] / way[2];
    return t > 0 && t < 40 * this.height ? [eye[0] + t * way[0], eye[1] + t * way[1]] : null;
  }
  // Metres per second in the world: keys and stick as the camera sees them.
  velocity() {
    let [x, y] = this.pad;
    for (const code of this.held) { x += KEYS[code][0]; y += KEYS[code][1]; }
    const n = Math.hypot(x, y);
    if (n < 0.05) return [0, 0];
    const speed = (this.shift ? this.fast : Number(this.$("speed").value)) * Math.min(n, 1) / n;
    return turned(speed * x, speed * y, this.yaw + Math.PI / 2);
  }
  tick(now) {
    // A frame's time may lie before the moment at which the page was ready.
    const passed = Math.max(0, (now - this.last) / 1000), start = performance.now();
    this.last = now;
    this.advance(Math.min(passed, LONGEST));
    this.draw();
    const cost = performance.now() - start;
    this.cost = this.cost ? 0.95 * this.cost + 0.05 * cost : cost;
    this.count(passed);
    this.root.dataset.state = "ready";
    requestAnimationFrame((time) => this.tick(time));
  }
  advance(dt) {
    const { figure } = this;
    let wanted = this.path && this.path.wanted(figure, Number(this.$("speed").value));
    if (this.path && !wanted) this.path = null;
    const stick = figure.stick(wanted ? this.along(wanted) : this.velocity(), dt);
    figure.advance(wanted || stick, dt);
    const last = this.trail[this.trail.length - 1];
    if (!last || Math.hypot(last[0] - figure.place[0], last[1] - figure.place[1]) > 0.15) this.trail.push([...figure.place]);
    if (this.trail.length > 120) this.trail.shift();
  }
  // The velocity that a path asks for, so that the springs are right when it ends.
  along(wanted) { return wanted.places[0].map((v, i) => (v - this.figure.place[i]) / this.clips.horizons[0]); }
  count(passed) {
    this.frames.push(passed);
    if (this.frames.reduce((a, b) => a + b, 0) < 0.5) return;
    const fps = this.frames.length / this.frames.reduce((a, b) => a + b, 0), { figure, clips, root } = this;
    this.adapt(fps);
    this.frames = [];
    Object.assign(root.dataset, { fps: fps.toFixed(1), ms: this.cost.toFixed(2), detail: this.detail.toFixed(2), searches: figure.searches, jumps: figure.jumps, x: figure.place[0].toFixed(3), y: figure.place[1].toFixed(3), yaw: figure.yaw.toFixed(3) });
    this.$("figures").textContent = `${fps.toFixed(0)} frames/s, ${this.cost.toFixed(1)} ms each, search ${(figure.searchMs || 0).toFixed(2)} ms of ${clips.frames} frames`;
    const k = clips.clip(Math.floor(figure.at));
    this.$("clip").textContent = `${clips.clips[k]}, ${((figure.at - clips.starts[k]) / clips.fps).toFixed(1)} s`;
  }
  // Where drawing is slow though the script is not, as without a graphics card, fewer pixels are drawn.
  adapt(fps) {
    const hidden = this.frames.some((passed) => passed > 0.25);
    this.slow = fps < SLOW && this.cost < 8 && !hidden ? this.slow + 1 : 0;
    if (this.slow > 1 && this.detail > COARSEST) { this.detail = Math.max(COARSEST, 0.7 * this.detail); this.slow = 0; }
  }
  draw() {
    const stage = this.$("stage"), ratio = this.detail * Math.min(2, window.devicePixelRatio || 1), { figure, painter, clips } = this;
    const size = [stage.clientWidth, stage.clientHeight].map((v) => Math.max(1, Math.round(v * ratio)));
    if (stage.width !== size[0] || stage.height !== size[1]) [stage.width, stage.height] = size;
    if (this.$("follow").checked && !this.root.classList.contains("drawing")) [0, 1].forEach((i) => { this.centre[i] += 0.12 * (figure.place[i] - this.centre[i]); });
    const target = this.centre.map((v, i) => v + this.pan[i]), { view, eye } = this.look(target, size), { gl } = painter;
    this.camera = { eye, target };
    painter.begin(view, eye, size, 0.021 * this.distance);
    const pose = figure.pose(), places = clips.places(pose), bones = [], shadow = [], floor = [], points = [], flat = (p) => [p[0], p[1], 0];
    clips.parents.forEach((parent, j) => { if (parent >= 0) bones.push([places[parent], places[j], SIDES[clips.sides[j]]]); });
    clips.tipPlaces(pose, places).forEach(([a, b, j]) => bones.push([a, b, SIDES[clips.sides[j]]]));
    for (const [a, b] of bones) shadow.push([flat(a), flat(b), SHADOW]);
    const line = (list, colour) => list.slice(1).forEach((p, i) => floor.push([[...list[i], 0], [...p, 0], colour]));
    if (this.drawn.length) line(this.drawn, PATH);
    gl.depthMask(false); painter.drawLines(this.grid(target), ratio); painter.drawLines(shadow, 6 * ratio);
    if (this.$("trajectory").checked) {
      line(this.trail, TRAIL);
      line([figure.place, ...figure.wanted.places], WANTED);
      figure.wanted.places.forEach((p, i) => { const [x, y] = turned(0.25 * this.height / 1.7, 0, figure.wanted.yaw[i]); floor.push([[...p, 0], [p[0] + x, p[1] + y, 0], WANTED]); points.push([[...p, 0], WANTED, 9]); });
    }
    painter.drawLines(floor, 2 * ratio); painter.drawPoints(points, ratio); gl.depthMask(true);
    painter.drawLines(bones, 6 * ratio);
    painter.drawPoints(places.map((p, j) => [p, SIDES[clips.sides[j]], 8]), ratio);
  }
}

for (const root of document.querySelectorAll(".steering")) {
  try {
    root.steering = new Steering(root, JSON.parse(root.querySelector("script[type='application/json']").textContent));
  } catch (error) {
    const message = root.querySelector("[data-part=message]");
    message.hidden = false; message.textContent = error.message;
    root.dataset.state = "failed";
  }
}
