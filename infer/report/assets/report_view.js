"use strict";
// The 3D view: a canvas, a pinhole of its own, lines sorted by depth. World: Z up, metres.
// A pinhole is {R: rows right, down, forward; C: centre; f: focal length in canvas px; cx, cy}.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const mul = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => mul(a, 1 / (Math.hypot(...a) || 1));
const clamp = (v, lo, hi) => Math.min(Math.max(v, lo), hi);
const NEAR = 0.05;

function decodeBytes(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

// Positions of landmarks or joints: point(t, j) is [x, y, z] or null where it is missing.
class Track {
  constructor(packed, count) {
    // Little-endian, as every machine with a browser is.
    this.codes = new Int16Array(decodeBytes(packed.data).buffer);
    this.count = count;
    this.offset = packed.offset;
    this.step = packed.step;
  }
  point(t, j) {
    const at = 3 * (t * this.count + j);
    if (this.codes[at] === -32768) return null;
    return [0, 1, 2].map((k) => this.offset[k] + this.codes[at + k] * this.step);
  }
  frame(t) {
    const points = [];
    for (let j = 0; j < this.count; j++) points.push(this.point(t, j));
    return points;
  }
}

class View {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.context = canvas.getContext("2d");
    this.landmarks = { ...scene.landmarks, track: new Track(scene.landmarks.positions, scene.landmarks.names.length) };
    this.number = scene.number;
    this.others = (scene.others || []).map((packed) => ({ ...scene.landmarks, track: new Track(packed, scene.landmarks.names.length) }));
    this.joints = scene.joints && { ...scene.joints, track: new Track(scene.joints.positions, scene.joints.names.length) };
    this.show = { points: true, joints: !!this.joints, cameras: true, trails: false, names: false, follow: false };
    this.through = -1;
    this.t = 0;
    this.onchange = () => {};
    this.measureTake();
    this.reset();
    this.readColours();
    this.listen();
    // In the next frame: drawing inside the observer could resize what it observes.
    new ResizeObserver(() => requestAnimationFrame(() => this.draw())).observe(canvas);
  }

  measureTake() {
    const track = this.landmarks.track, total = track.codes.length / 3 / track.count;
    const every = Math.max(1, Math.floor(total / 200)), axes = [[], [], []];
    for (let t = 0; t < total; t += every)
      for (const p of track.frame(t)) if (p) p.forEach((v, k) => axes[k].push(v));
    const at = (k, q) => {
      const sorted = axes[k];
      return sorted.length ? sorted[Math.floor(q * (sorted.length - 1))] : 0;
    };
    axes.forEach((values) => values.sort((a, b) => a - b));
    this.middle = [at(0, 0.5), at(1, 0.5), 0.5 * (at(2, 0.02) + at(2, 0.98))];
    this.extent = Math.max(1.2, ...[0, 1, 2].map((k) => at(k, 0.98) - at(k, 0.02)));
    // The ground is z = 0; in a world with another origin it is drawn under the feet.
    const feet = at(2, 0.02);
    this.ground = Math.abs(feet) < 0.6 ? 0 : feet;
  }

  reset() {
    this.through = -1;
    this.target = this.middle.slice();
    this.yaw = this.facing() + 0.55;
    this.pitch = 0.22;
    this.distance = 2.3 * this.extent;
    this.target[2] -= 0.03 * this.extent;
  }

  // The direction the person faces at the middle of the take, so that "front" means it.
  facing() {
    const names = this.landmarks.names, track = this.landmarks.track;
    const index = (n) => names.indexOf(n), total = track.codes.length / 3 / track.count;
    for (let k = 0; k < total; k++) {
      const t = (Math.floor(total / 2) + k) % total;
      for (const part of ["hip", "shoulder"]) {
        const [l, r] = [index("left_" + part), index("right_" + part)];
        if (l < 0 || r < 0) continue;
        const a = track.point(t, l), b = track.point(t, r);
        if (a && b) {
          const forward = cross(sub(a, b), [0, 0, 1]);
          return Math.atan2(forward[1], forward[0]);
        }
      }
    }
    return -Math.PI / 2;
  }

  lookFrom(name) {
    const front = this.facing();
    const poses = { front: [front, 0.08], left: [front + Math.PI / 2, 0.08], right: [front - Math.PI / 2, 0.08], back: [front + Math.PI, 0.08], top: [front, 1.52] };
    this.reset();
    if (poses[name]) [this.yaw, this.pitch] = poses[name];
    if (name === "room") this.wholeRoom();
    this.through = this.scene.cameras.findIndex((camera) => "camera:" + camera.name === name);
    this.draw();
  }

  // Far enough for every camera to be in the picture.
  wholeRoom() {
    const centres = this.scene.cameras.map((camera) => camera.center).concat([this.middle]);
    this.target = mul(centres.reduce(add), 1 / centres.length);
    this.pitch = 0.5;
    this.distance = 1.1 + 1.65 * Math.max(...centres.map((c) => Math.hypot(...sub(c, this.target))));
  }

  readColours() {
    const style = getComputedStyle(document.documentElement);
    this.colour = Object.fromEntries(
      ["left", "right", "middle", "grid", "shadow", "frustum", "text", "soft", "figure-edge", "missing", "bar", "heat", "accent", "line", "card"]
        .map((name) => [name, style.getPropertyValue("--" + name).trim()]));
  }

  pinhole(width, height) {
    if (this.through >= 0) {
      const camera = this.scene.cameras[this.through];
      const imageHeight = 0.94 * Math.min(height, width / camera.aspect), imageWidth = imageHeight * camera.aspect;
      this.frame = [(width - imageWidth) / 2, (height - imageHeight) / 2, imageWidth, imageHeight];
      return { R: camera.rotation, C: camera.center, f: camera.focal * imageHeight,
        cx: this.frame[0] + camera.principal[0] * imageWidth, cy: this.frame[1] + camera.principal[1] * imageHeight };
    }
    this.frame = null;
    const c = Math.cos(this.pitch);
    const away = [c * Math.cos(this.yaw), c * Math.sin(this.yaw), Math.sin(this.pitch)];
    const forward = mul(away, -1), right = norm(cross(forward, [0, 0, 1])), down = cross(forward, right);
    return { R: [right, down, forward], C: add(this.target, mul(away, this.distance)), f: 1.35 * Math.min(width, height), cx: width / 2, cy: height / 2 };
  }

  // Camera coordinates and pixels of a world point.
  toEye(hole, p) { const d = sub(p, hole.C); return hole.R.map((row) => dot(row, d)); }
  toPixel(hole, e) { return [hole.cx + (hole.f * e[0]) / e[2], hole.cy + (hole.f * e[1]) / e[2]]; }

  // A segment between world points, cut at the near plane: {a, b: px, depth} or null.
  segment(hole, p, q) {
    let a = this.toEye(hole, p), b = this.toEye(hole, q);
    if (a[2] < NEAR && b[2] < NEAR) return null;
    if (a[2] < NEAR || b[2] < NEAR) {
      const s = (NEAR - a[2]) / (b[2] - a[2]), cut = add(a, mul(sub(b, a), s));
      if (a[2] < NEAR) a = cut; else b = cut;
    }
    return { a: this.toPixel(hole, a), b: this.toPixel(hole, b), depth: 0.5 * (a[2] + b[2]) };
  }

  draw() {
    const box = this.canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
    const width = box.width, height = box.height;
    if (!width || !height) return;
    const w = Math.round(width * ratio), h = Math.round(height * ratio);
    if (this.canvas.width !== w || this.canvas.height !== h) { this.canvas.width = w; this.canvas.height = h; }
    const g = this.context;
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    g.lineCap = g.lineJoin = "round";
    const points = this.landmarks.track.frame(this.t);
    const joints = this.joints ? this.joints.track.frame(this.t) : null;
    if (this.show.follow && this.through < 0) this.followPerson(points, joints);
    const hole = this.pinhole(width, height);
    this.drawGround(g, hole);
    this.drawShadow(g, hole, this.show.joints && joints ? joints : points, this.show.joints && joints ? this.joints : this.landmarks);
    if (this.show.trails) this.drawTrails(g, hole);
    const parts = [];
    if (this.show.cameras) this.cameraParts(hole, parts);
    if (this.show.joints && joints) this.figureParts(hole, parts, this.joints, joints, true);
    if (this.show.points) this.figureParts(hole, parts, this.landmarks, points, false);
    const others = this.others.map((other) => other.track.frame(this.t));
    others.forEach((found, k) => {
      this.drawShadow(g, hole, found, this.others[k]);
      this.figureParts(hole, parts, this.others[k], found, false);
    });
    parts.sort((x, y) => y.depth - x.depth);
    for (const part of parts) part.draw(g);
    if (this.show.names) this.drawNames(g, hole, points, joints);
    if (others.length) {
      others.splice(this.number - 1, 0, points);
      others.forEach((found, k) => this.drawNumber(g, hole, found, String(k + 1)));
    }
    if (this.frame) {
      g.strokeStyle = this.colour.frustum; g.lineWidth = 1.5; g.setLineDash([6, 5]);
      g.strokeRect(...this.frame); g.setLineDash([]);
    }
    this.onchange(points);
  }

  // Above the highest point of a person, where there are several.
  drawNumber(g, hole, points, number) {
    const top = points.filter(Boolean).reduce((best, p) => (!best || p[2] > best[2] ? p : best), null);
    const e = top && this.toEye(hole, add(top, [0, 0, 0.25]));
    if (!e || e[2] < NEAR) return;
    g.fillStyle = this.colour.text; g.font = "600 14px system-ui, sans-serif"; g.textAlign = "center";
    g.fillText(number, ...this.toPixel(hole, e));
    g.textAlign = "start";
  }

  followPerson(points, joints) {
    const seen = (joints || points).filter(Boolean);
    if (!seen.length) return;
    const centre = mul(seen.reduce(add), 1 / seen.length);
    this.target[0] += 0.25 * (centre[0] - this.target[0]);
    this.target[1] += 0.25 * (centre[1] - this.target[1]);
  }

  drawGround(g, hole) {
    const reach = Math.ceil(clamp(1.3 * this.extent, 3, 12)), x0 = Math.round(this.middle[0]), y0 = Math.round(this.middle[1]);
    g.strokeStyle = this.colour.grid;
    for (let i = -reach; i <= reach; i++)
      for (let k = -reach; k < reach; k++)
        for (const across of [true, false]) {
          const p = across ? [x0 + k, y0 + i, this.ground] : [x0 + i, y0 + k, this.ground];
          const q = across ? [p[0] + 1, p[1], p[2]] : [p[0], p[1] + 1, p[2]];
          const far = Math.hypot(i, k + 0.5) / reach;
          if (far > 1) continue;
          const s = this.segment(hole, p, q);
          if (!s) continue;
          g.globalAlpha = 0.55 * (1 - far) ** 1.2;
          g.lineWidth = 1;
          this.line(g, s);
        }
    g.globalAlpha = 1;
  }

  drawShadow(g, hole, points, body) {
    g.strokeStyle = this.colour.shadow; g.globalAlpha = 0.16;
    for (const [i, j] of body.edges) {
      if (!points[i] || !points[j]) continue;
      const s = this.segment(hole, [points[i][0], points[i][1], this.ground], [points[j][0], points[j][1], this.ground]);
      if (s) { g.lineWidth = clamp((0.06 * hole.f) / s.depth, 1.5, 40); this.line(g, s); }
    }
    g.globalAlpha = 1;
  }

  line(g, s) { g.beginPath(); g.moveTo(...s.a); g.lineTo(...s.b); g.stroke(); }

  figureParts(hole, parts, body, points, solid) {
    const both = this.show.points && this.show.joints && this.joints;
    const thick = solid ? 0.05 : both ? 0.008 : 0.016, ball = solid ? 0.03 : both ? 0.016 : 0.022;
    const edges = solid ? body.edges : body.edges.concat(this.neck());
    const nearest = points.map((p) => (p ? this.toEye(hole, p)[2] : 0));
    for (const [i, j] of edges) {
      const p = this.at(points, i), q = this.at(points, j);
      if (!p || !q) continue;
      const s = this.segment(hole, p, q);
      if (!s) continue;
      // A ball is drawn after every bone that ends in it.
      for (const k of [i, j]) if (typeof k === "number") nearest[k] = Math.min(nearest[k], s.depth);
      const sides = [i, j].map((k) => (typeof k === "number" ? body.sides[k] : "middle"));
      const colour = this.colour[sides[0] === sides[1] ? sides[0] : solid ? sides[1] : "middle"];
      const width = Math.max(solid ? 3 : 1.5, (thick * hole.f) / s.depth);
      parts.push({ depth: s.depth, draw: (g) => {
        g.globalAlpha = solid && both ? 0.5 : 1;
        if (solid || !both) { g.strokeStyle = this.colour["figure-edge"]; g.lineWidth = width + 2.5; this.line(g, s); }
        g.strokeStyle = colour; g.lineWidth = width; this.line(g, s);
        g.globalAlpha = 1;
      } });
    }
    if (solid) {
      this.headPart(hole, parts, body, points, both);
      return;
    }
    points.forEach((p, j) => {
      if (!p) return;
      const e = this.toEye(hole, p);
      if (e[2] < NEAR) return;
      const px = this.toPixel(hole, e), radius = Math.max(2.2, (ball * hole.f) / e[2]);
      parts.push({ depth: nearest[j] - 0.001, draw: (g) => {
        g.beginPath(); g.arc(px[0], px[1], radius, 0, 2 * Math.PI);
        g.fillStyle = this.colour[body.sides[j]]; g.strokeStyle = this.colour["figure-edge"]; g.lineWidth = 1.5;
        g.fill(); g.stroke();
      } });
    });
  }

  // A skeleton ends where the head begins: a ball there tells up from down.
  headPart(hole, parts, body, points, faint) {
    const j = body.names.findIndex((name) => name.toLowerCase() === "head");
    const edge = body.edges.find(([, child]) => child === j);
    if (j < 0 || !edge || !points[j] || !points[edge[0]]) return;
    const e = this.toEye(hole, add(points[j], mul(norm(sub(points[j], points[edge[0]])), 0.09)));
    if (e[2] < NEAR) return;
    const px = this.toPixel(hole, e), radius = (0.095 * hole.f) / e[2];
    parts.push({ depth: e[2], draw: (g) => {
      g.globalAlpha = faint ? 0.5 : 1;
      g.beginPath(); g.arc(px[0], px[1], radius, 0, 2 * Math.PI);
      g.fillStyle = this.colour.middle; g.strokeStyle = this.colour["figure-edge"]; g.lineWidth = 1.5;
      g.fill(); g.stroke();
      g.globalAlpha = 1;
    } });
  }

  // Landmarks have no neck: a line from between the shoulders to between the ears keeps the head in place.
  neck() {
    const index = (n) => this.landmarks.names.indexOf(n);
    const pairs = [["left_shoulder", "right_shoulder"], ["left_ear", "right_ear"]].map((pair) => pair.map(index));
    return pairs.flat().includes(-1) ? [] : [[pairs[0], pairs[1]]];
  }
  at(points, key) {
    if (typeof key === "number") return points[key];
    const [a, b] = key.map((k) => points[k]);
    return a && b ? mul(add(a, b), 0.5) : null;
  }

  cameraParts(hole, parts) {
    const size = 0.16 * Math.sqrt(this.extent);
    this.scene.cameras.forEach((camera, c) => {
      if (c === this.through) return;
      const corners = camera.corners.map((ray) => add(camera.center, mul(ray, size / Math.hypot(...camera.corners[0]) * 1.6)));
      const lines = corners.map((p, k) => [p, corners[(k + 1) % 4]]).concat(corners.map((p) => [camera.center, p]));
      lines.forEach(([p, q], k) => {
        const s = this.segment(hole, p, q);
        // The upper edge of the image is drawn strong: it tells which way up the camera is.
        if (s) parts.push({ depth: s.depth, draw: (g) => { g.strokeStyle = this.colour.frustum; g.lineWidth = k === 0 ? 3 : 1.3; this.line(g, s); } });
      });
      const e = this.toEye(hole, camera.center);
      if (e[2] < NEAR) return;
      const px = this.toPixel(hole, e);
      parts.push({ depth: e[2], draw: (g) => this.label(g, camera.name, px[0], px[1] - 10, this.colour.text, "center") });
    });
  }

  label(g, text, x, y, colour, align) {
    g.font = "12.5px system-ui, sans-serif"; g.textAlign = align;
    g.strokeStyle = this.colour["figure-edge"]; g.lineWidth = 3.5; g.strokeText(text, x, y);
    g.fillStyle = colour; g.fillText(text, x, y);
  }

  drawNames(g, hole, points, joints) {
    const body = this.show.points || !joints ? this.landmarks : this.joints;
    (body === this.landmarks ? points : joints).forEach((p, j) => {
      if (!p) return;
      const e = this.toEye(hole, p);
      if (e[2] < NEAR) return;
      const [x, y] = this.toPixel(hole, e), right = e[0] >= 0;
      this.label(g, body.names[j].replaceAll("_", " "), x + (right ? 9 : -9), y + 4, this.colour[body.sides[j]], right ? "left" : "right");
    });
  }

  // Where wrists and ankles were in the last second and will be in the next.
  drawTrails(g, hole) {
    const body = this.landmarks, span = Math.max(2, Math.round(this.scene.fps / this.scene.stride));
    const total = body.track.codes.length / 3 / body.track.count;
    ["left_wrist", "right_wrist", "left_ankle", "right_ankle"].forEach((name) => {
      const j = body.names.indexOf(name);
      if (j < 0) return;
      g.strokeStyle = this.colour[body.sides[j]]; g.lineWidth = 2;
      for (let t = Math.max(0, this.t - span); t < Math.min(total - 1, this.t + span); t++) {
        const p = body.track.point(t, j), q = body.track.point(t + 1, j), s = p && q && this.segment(hole, p, q);
        if (!s) continue;
        g.globalAlpha = (t < this.t ? 0.8 : 0.25) * (1 - Math.abs(t - this.t) / (span + 1));
        this.line(g, s);
      }
    });
    g.globalAlpha = 1;
  }

  turn(dx, dy) {
    this.leave();
    this.yaw -= dx * 0.008;
    this.pitch = clamp(this.pitch + dy * 0.008, -1.2, 1.55);
    this.draw();
  }
  zoom(factor) { this.leave(); this.distance = clamp(this.distance * factor, 0.4, 60); this.draw(); }
  pan(dx, dy) {
    this.leave();
    const box = this.canvas.getBoundingClientRect(), hole = this.pinhole(box.width, box.height), s = this.distance / hole.f;
    this.target = add(this.target, add(mul(hole.R[0], -dx * s), mul(hole.R[1], -dy * s)));
    this.draw();
  }
  leave() { if (this.through >= 0) { this.reset(); this.onleave(); } }
  onleave() {}

  listen() {
    const held = new Map(), canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, [event.clientX, event.clientY]); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => held.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
      if (held.size === 1) {
        if (event.buttons & 2 || event.shiftKey) this.pan(dx, dy); else this.turn(dx, dy);
      } else {
        const other = [...held].find(([id]) => id !== event.pointerId)[1];
        const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        this.zoom(apart(before) / apart(now));
        this.pan(dx / 2, dy / 2);
      }
      held.set(event.pointerId, now);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(clamp(event.deltaY * (event.deltaMode ? 0.05 : 0.0015), -0.4, 0.4)));
    }, { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", () => { this.reset(); this.onleave(); this.draw(); });
  }
}
