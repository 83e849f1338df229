"use strict";
// Motion matching, as muybridge.motion.matching has it: a tree of boxes, springs, inertialised transitions.
// Quaternions are w, x, y, z; a yaw is in radians from the X axis towards Y.
const LANES = 16, FAN = 4, NEAR = 0.2;
const wrap = (a) => Math.atan2(Math.sin(a), Math.cos(a));
const turned = (x, y, a) => [Math.cos(a) * x - Math.sin(a) * y, Math.sin(a) * x + Math.cos(a) * y];
const times = (a, b) => [
  a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
  a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1], a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]];
const rotvec = (q) => {
  const s = q[0] < 0 ? -1 : 1, n = Math.hypot(q[1], q[2], q[3]), f = n > 1e-12 ? 2 * Math.atan2(n, s * q[0]) / n : 2;
  return [s * f * q[1], s * f * q[2], s * f * q[3]];
};
const quatOf = (v) => {
  const a = Math.hypot(v[0], v[1], v[2]), f = a > 1e-12 ? Math.sin(a / 2) / a : 0.5;
  return [Math.cos(a / 2), f * v[0], f * v[1], f * v[2]];
};
const rotated = (q, v) => {
  const [w, x, y, z] = q, a = 2 * (y * v[2] - z * v[1]), b = 2 * (z * v[0] - x * v[2]), c = 2 * (x * v[1] - y * v[0]);
  return [v[0] + w * a + y * c - z * b, v[1] + w * b + z * a - x * c, v[2] + w * c + x * b - y * a];
};

// The clips: poses, facing frames and scaled features of every frame.
class Clips {
  constructor(packed) {
    Object.assign(this, packed);
    this.path = decode(packed.path, Float32Array);
    this.codes = decode(packed.turns, Uint16Array);
    this.rootCodes = decode(packed.roots.data, Int16Array);
    this.slideCodes = packed.slides && decode(packed.slides.data, Int16Array);
    const raw = decode(packed.features.data, Uint16Array), { low, step } = packed.features, width = low.length;
    this.width = width; this.horizon = packed.horizons.length;
    this.scaled = new Float32Array(raw.length);
    for (let i = 0; i < raw.length; i++) this.scaled[i] = low[i % width] + step[i % width] * raw[i];
    this.ends = new Int32Array(this.frames);
    for (let k = 0, from = 0; k < this.stops.length; from = this.stops[k], k++) this.ends.fill(this.stops[k], from, this.stops[k]);
    this.tree = new BoxTree(this.scaled, width, packed.searchable);
  }
  clip(frame) { let k = 0; while (this.starts[k + 1] <= frame) k++; return k; }
  // x, y and yaw of the facing frame between frames.
  facing(at) {
    const i = Math.min(Math.floor(at), this.frames - 1), j = Math.min(i + 1, this.ends[i] - 1), s = j > i ? at - i : 0, p = this.path;
    return [0, 1, 2].map((c) => p[3 * i + c] + s * (p[3 * j + c] - p[3 * i + c]));
  }
  quat(frame, m, out) {
    const at = 3 * (frame * this.moving.length + m), [a, b, c] = [this.codes[at], this.codes[at + 1], this.codes[at + 2]];
    const largest = (a >> 15) + 2 * (b >> 15), rest = [a & 32767, b & 32767, c & 32767].map((v) => (v / 32767 * 2 - 1) * Math.SQRT1_2);
    const w = Math.sqrt(Math.max(0, 1 - rest[0] ** 2 - rest[1] ** 2 - rest[2] ** 2));
    for (let i = 0, k = 0; i < 4; i++) out[i] = i === largest ? w : rest[k++];
    return out;
  }
  // The pose between frames: root (3) in the facing frame, local turns (J) and slides (S).
  pose(at) {
    const i = Math.min(Math.floor(at), this.frames - 1), j = Math.min(i + 1, this.ends[i] - 1), s = j > i ? at - i : 0;
    const between = (codes, { offset, step }, size, k) => [0, 1, 2].map((c) => {
      const a = codes[size * i + 3 * k + c], b = codes[size * j + 3 * k + c];
      return offset[c] + step * (a + s * (b - a));
    });
    const turns = this.still.map((q) => q), one = [0, 0, 0, 0], other = [0, 0, 0, 0];
    this.moving.forEach((joint, m) => {
      this.quat(i, m, one); this.quat(j, m, other);
      const sign = one[0] * other[0] + one[1] * other[1] + one[2] * other[2] + one[3] * other[3] < 0 ? -1 : 1;
      const q = one.map((v, c) => v + s * (sign * other[c] - v)), n = Math.hypot(...q) || 1;
      turns[joint] = q.map((v) => v / n);
    });
    return { root: between(this.rootCodes, this.roots, 3, 0), turns,
      slides: this.sliding.map((_, k) => between(this.slideCodes, this.slides, 3 * this.sliding.length, k)) };
  }
  // World places of the joints of a pose whose first root stands at `root`; the pose keeps their turns.
  places(pose) {
    const worlds = pose.worlds = [], out = [];
    this.parents.forEach((parent, j) => {
      const k = this.sliding.indexOf(j), shift = k >= 0 ? pose.slides[k] : this.offsets[j];
      if (parent < 0) { worlds[j] = pose.turns[j]; out[j] = j ? shift : pose.root; return; }
      const away = rotated(worlds[parent], shift), from = out[parent];
      worlds[j] = times(worlds[parent], pose.turns[j]);
      out[j] = [from[0] + away[0], from[1] + away[1], from[2] + away[2]];
    });
    return out;
  }
  // Lines from joints to the ends of their bones, with the joints' numbers.
  tipPlaces(pose, places) {
    return this.tips.flatMap((tip, j) => {
      if (!tip) return [];
      const away = rotated(pose.worlds[j], tip), p = places[j];
      return [[p, [p[0] + away[0], p[1] + away[1], p[2] + away[2]], j]];
    });
  }
}

// Bounding boxes of 16 and of 64 consecutive frames.
class BoxTree {
  constructor(scaled, width, runs) {
    this.scaled = scaled; this.width = width;
    this.small = [];
    for (const [from, to] of runs) for (let a = from; a < to; a += LANES) this.small.push([a, Math.min(a + LANES, to)]);
    const boxes = (spans, limits) => { const low = new Float32Array(spans.length * width).fill(Infinity), high = new Float32Array(spans.length * width).fill(-Infinity); spans.forEach((s, b) => limits(s, b, low, high)); return [low, high]; };
    [this.low, this.high] = boxes(this.small, ([a, z], b, low, high) => {
      for (let t = a; t < z; t++) for (let f = 0; f < width; f++) { const v = scaled[t * width + f], at = b * width + f; if (v < low[at]) low[at] = v; if (v > high[at]) high[at] = v; }
    });
    const large = Array.from({ length: Math.ceil(this.small.length / FAN) }, (_, b) => b);
    [this.farLow, this.farHigh] = boxes(large, (b, _, low, high) => {
      for (let s = b * FAN; s < Math.min((b + 1) * FAN, this.small.length); s++) for (let f = 0; f < width; f++) {
        const at = b * width + f;
        low[at] = Math.min(low[at], this.low[s * width + f]); high[at] = Math.max(high[at], this.high[s * width + f]);
      }
    });
    this.far = new Float64Array(large.length);
  }
  gap(query, low, high, b, limit) {
    let sum = 0;
    for (let f = 0, at = b * this.width; f < this.width && sum < limit; f++, at++) {
      const q = query[f], d = q < low[at] ? low[at] - q : q > high[at] ? q - high[at] : 0;
      sum += d * d;
    }
    return sum;
  }
  // The frame nearest to a query, none of those from `skip[0]` to before `skip[1]`; -1 where none is below the bound.
  search(query, bound = Infinity, skip = [0, 0]) {
    let best = bound, at = -1, first = 0;
    const { width, scaled, far } = this;
    for (let b = 0; b < far.length; b++) { far[b] = this.gap(query, this.farLow, this.farHigh, b, Infinity); if (far[b] < far[first]) first = b; }
    const look = (b) => {
      if (far[b] >= best) return;
      for (let s = b * FAN; s < Math.min((b + 1) * FAN, this.small.length); s++) {
        if (this.gap(query, this.low, this.high, s, best) >= best) continue;
        for (let t = this.small[s][0]; t < this.small[s][1]; t++) {
          if (t >= skip[0] && t < skip[1]) continue;
          let sum = 0;
          for (let f = 0, k = t * width; f < width && sum < best; f++, k++) { const d = scaled[k] - query[f]; sum += d * d; }
          if (sum < best) { best = sum; at = t; }
        }
      }
    };
    look(first);
    for (let b = 0; b < far.length; b++) if (b !== first) look(b);
    return [at, best];
  }
}

// Critically damped: the value is goal + (a + b t) exp(-d t).
class Spring {
  constructor(value, rate = 0) { this.value = value; this.rate = rate; }
  terms(goal, halflife) { const d = 2 * Math.LN2 / halflife, a = this.value - goal; return [d, a, this.rate + d * a]; }
  advance(goal, t, halflife) {
    const [d, a, b] = this.terms(goal, halflife), left = Math.exp(-d * t);
    this.value = goal + (a + b * t) * left; this.rate = (b - d * (a + b * t)) * left;
  }
  at(goal, t, halflife) { const [d, a, b] = this.terms(goal, halflife); return goal + (a + b * t) * Math.exp(-d * t); }
  sum(goal, t, halflife) {
    const [d, a, b] = this.terms(goal, halflife), left = Math.exp(-d * t);
    return goal * t + a * (1 - left) / d + b * (1 - left * (1 + d * t)) / (d * d);
  }
}

// What is left after t seconds of a difference with offset, rate and bend (second derivative), gone after `seconds`.
function decayed(offset, rate, bend, seconds, t) {
  const s = t / seconds, rest = (1 - s) ** 3;
  const [x, v, a] = [rest * (1 + 3 * s + 6 * s * s), rest * (s + 3 * s * s) * seconds, rest * s * s / 2 * seconds * seconds];
  return offset.map((o, i) => x * o + v * rate[i] + a * bend[i]);
}

class Difference {
  // Of differences one and two frames before the transition, and at it.
  constructor(two, one, now, fps) {
    this.offset = now;
    this.bend = now.map((v, i) => (v - 2 * one[i] + two[i]) * fps * fps);
    this.rate = now.map((v, i) => (v - one[i]) * fps + 0.5 * this.bend[i] / fps);
  }
  after(t, seconds) { return decayed(this.offset, this.rate, this.bend, seconds, t); }
}

// A figure that is steered: which frame plays, where it stands, and what is left of the last transition.
class Figure {
  constructor(clips, options) {
    this.clips = clips; this.options = options;
    this.place = [0, 0]; this.yaw = Math.PI / 2; this.at = 0; this.since = 0; this.sinceSearch = Infinity; this.transition = null;
    this.moved = [new Spring(0), new Spring(0)]; this.face = new Spring(this.yaw); this.faceGoal = this.yaw; this.goal = [0, 0];
    this.searches = 0; this.jumps = 0;
    this.wanted = this.stick([0, 0], 0);
    this.at = this.first();
  }
  get turn() { return this.yaw - this.clips.facing(this.at)[2]; }
  // The trajectory that a stick asks for with a velocity, metres per second in the world.
  stick(velocity, dt) {
    const { halflife, turnHalflife } = this.options, h = this.clips.horizons;
    this.moved.forEach((s, i) => s.advance(this.goal[i], dt, halflife));
    this.face.advance(this.faceGoal, dt, turnHalflife);
    const changed = Math.hypot(velocity[0] - this.goal[0], velocity[1] - this.goal[1]) > 0.1;
    this.goal = velocity;
    const toward = Math.hypot(...velocity) > 0.1 ? Math.atan2(velocity[1], velocity[0]) : this.faceGoal;
    this.faceGoal = this.yaw + wrap(toward - this.yaw); this.face.value = this.yaw + wrap(this.face.value - this.yaw);
    return { changed, yaw: h.map((t) => this.face.at(this.faceGoal, t, turnHalflife)),
      places: h.map((t) => this.moved.map((s, i) => this.place[i] + s.sum(velocity[i], t, halflife))) };
  }
  first() {
    const query = this.query(0), k = 4 * this.clips.horizon;
    let best = Infinity, at = 0;
    for (const [a, z] of this.clips.searchable) for (let t = a; t < z; t++) {
      let sum = 0;
      for (let f = 0; f < k; f++) sum += (this.clips.scaled[t * this.clips.width + f] - query[f]) ** 2;
      if (sum < best) { best = sum; at = t; }
    }
    return at;
  }
  // Scaled: the wanted trajectory with the pose of a frame.
  query(frame) {
    const { clips } = this, { width, horizon, mean, factor } = clips;
    const out = clips.scaled.slice(frame * width, (frame + 1) * width);
    const put = (f, value) => { out[f] = (value - mean[f]) * factor[f]; };
    for (let k = 0; k < horizon; k++) {
      const [x, y] = turned(this.wanted.places[k][0] - this.place[0], this.wanted.places[k][1] - this.place[1], -this.yaw);
      const a = this.wanted.yaw[k] - this.yaw;
      put(2 * k, x); put(2 * k + 1, y); put(2 * (horizon + k), Math.cos(a)); put(2 * (horizon + k) + 1, Math.sin(a));
    }
    return out;
  }
  search() {
    const { clips } = this, frame = Math.floor(this.at), left = clips.ends[frame] - 1 - this.at, query = this.query(frame);
    let bound = Infinity;
    if (left >= 0.05 * clips.fps) {
      let sum = 0;
      for (let f = 0; f < clips.width; f++) sum += (clips.scaled[frame * clips.width + f] - query[f]) ** 2;
      bound = sum - this.options.transitionCost;
    }
    const near = Math.round(NEAR * clips.fps), start = performance.now();
    let [found] = bound > 0 ? clips.tree.search(query, bound, [frame - near, frame + near + 1]) : [-1];
    if (found < 0 && left < 0.05 * clips.fps) [found] = clips.tree.search(query);
    this.searchMs = performance.now() - start;
    this.searches++; this.sinceSearch = 0;
    if (found >= 0) this.jump(found);
  }
  // What is shown `back` frames before now: of a clip at `at`, with what is left of the last transition.
  shown(at, back, transition, since) {
    const { clips } = this, from = Math.max(at - back, 0), pose = clips.pose(from), now = clips.facing(at), then = clips.facing(from);
    const turn = this.yaw - now[2], way = turned(then[0] - now[0], then[1] - now[1], turn);
    const root = turned(pose.root[0], pose.root[1], turn + then[2]);
    pose.root = [this.place[0] + way[0] + root[0], this.place[1] + way[1] + root[1], pose.root[2]];
    const about = quatOf([0, 0, turn]);
    clips.parents.forEach((parent, j) => {
      if (parent >= 0) return;
      pose.turns[j] = times(about, pose.turns[j]);
      const k = clips.sliding.indexOf(j);
      if (k >= 0) { const [x, y] = turned(pose.slides[k][0] - now[0], pose.slides[k][1] - now[1], turn); pose.slides[k] = [this.place[0] + x, this.place[1] + y, pose.slides[k][2]]; }
    });
    const t = since - back / clips.fps, { blend } = this.options;
    if (transition && t < blend) {
      pose.root = pose.root.map((v, i) => v + transition.places.after(t, blend)[i]);
      pose.turns = pose.turns.map((q, j) => times(quatOf(transition.turns[j].after(t, blend)), q));
      pose.slides = pose.slides.map((s, k) => s.map((v, i) => v + transition.slides[k].after(t, blend)[i]));
    }
    return pose;
  }
  jump(frame) {
    const { fps } = this.clips, pairs = [2, 1, 0].map((back) => [this.shown(this.at, back, this.transition, this.since), this.shown(frame, back, null, 0)]);
    const away = (get) => pairs.map(([old, now]) => { const a = get(old), b = get(now); return a.map((v, i) => v - b[i]); });
    const turns = this.clips.parents.map((_, j) => {
      const quats = pairs.map(([old, now]) => times(old.turns[j], [now.turns[j][0], ...now.turns[j].slice(1).map((v) => -v)]));
      // All in the half of the last one, so that the vectors do not jump.
      const last = quats[2][0] < 0 ? quats[2].map((v) => -v) : quats[2];
      const vectors = quats.map((q) => { const d = q.reduce((s, v, i) => s + v * last[i], 0); return d < 0 ? q.map((v) => -v) : q; }).map((q) => {
        const n = Math.hypot(q[1], q[2], q[3]), f = n > 1e-12 ? 2 * Math.atan2(n, q[0]) / n : 2;
        return [f * q[1], f * q[2], f * q[3]];
      });
      return new Difference(...vectors, fps);
    });
    this.transition = { turns, places: new Difference(...away((p) => p.root), fps), slides: this.clips.sliding.map((_, k) => new Difference(...away((p) => p.slides[k]), fps)) };
    this.at = frame; this.since = 0; this.jumps++;
  }
  // Go on for dt seconds towards what is wanted.
  advance(wanted, dt) {
    const { clips } = this;
    this.wanted = wanted;
    const frame = Math.floor(this.at), left = clips.ends[frame] - 1 - this.at;
    if (this.sinceSearch >= this.options.searchEvery || (wanted.changed && this.sinceSearch > 0.05) || left < 0.05 * clips.fps) this.search();
    const now = clips.facing(this.at), turn = this.yaw - now[2];
    const next = Math.min(this.at + dt * clips.fps, clips.ends[Math.floor(this.at)] - 1), then = clips.facing(next);
    const turning = this.turning(dt), way = turned(then[0] - now[0], then[1] - now[1], turn + turning);
    this.place = [this.place[0] + way[0], this.place[1] + way[1]];
    this.yaw = turn + turning + then[2]; this.at = next; this.since += dt; this.sinceSearch += dt;
  }
  // Radians by which the figure is turned in dt beyond what its clip does.
  turning(dt) {
    const { clips } = this, k = 2 * clips.horizon, at = Math.floor(this.at) * clips.width + k;
    const cosine = clips.scaled[at] / clips.factor[k] + clips.mean[k], sine = clips.scaled[at + 1] / clips.factor[k + 1] + clips.mean[k + 1];
    const missing = wrap(this.wanted.yaw[0] - this.yaw - Math.atan2(sine, cosine)) / clips.horizons[0];
    return dt * clamp(missing, -this.options.turning, this.options.turning);
  }
  pose() { return this.shown(this.at, 0, this.transition, this.since); }
}

// A path over the floor that a figure follows: from the point that is nearest to it, and no farther back than before.
class GroundPath {
  constructor(points) {
    this.points = points; this.done = 0; this.along = [0];
    for (let i = 1; i < points.length; i++) this.along.push(this.along[i - 1] + Math.hypot(points[i][0] - points[i - 1][0], points[i][1] - points[i - 1][1]));
    this.length = this.along[points.length - 1];
  }
  at(way) {
    const s = clamp(way, 0, this.length);
    let i = 1;
    while (i < this.points.length - 1 && this.along[i] < s) i++;
    const part = (s - this.along[i - 1]) / (this.along[i] - this.along[i - 1] || 1), [a, b] = [this.points[i - 1], this.points[i]];
    return [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])];
  }
  yaw(way) { const [a, b] = [this.at(way - 0.15), this.at(way + 0.15)]; return Math.atan2(b[1] - a[1], b[0] - a[0]); }
  wanted(figure, speed) {
    let best = Infinity, done = this.done;
    for (let k = 0; k <= 50; k++) {
      const s = Math.min(this.done + k / 50 * Math.max(1, speed), this.length), p = this.at(s), gap = Math.hypot(p[0] - figure.place[0], p[1] - figure.place[1]);
      if (gap < best - 1e-9) { best = gap; done = s; }
    }
    this.done = done;
    if (done >= this.length - 0.05) return null;
    const ways = figure.clips.horizons.map((t) => done + speed * t);
    return { changed: false, places: ways.map((s) => this.at(s)), yaw: ways.map((s) => this.yaw(s)) };
  }
}
