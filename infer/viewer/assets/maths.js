"use strict";
// Vectors, matrices (column-major, as WebGL has them) and arrays in base64. World: Z up, metres.
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => { const n = Math.hypot(...a) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };
const clamp = (v, lo, hi) => Math.min(Math.max(v, lo), hi);

function decode(text, Kind) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Kind(bytes.buffer);
}

function product(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[4 * k + r] * b[4 * c + k];
    out[4 * c + r] = sum;
  }
  return out;
}

function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
}

function lookAt(eye, target) {
  const z = norm(sub(eye, target)), x = norm(cross([0, 0, 1], z)), y = cross(z, x);
  return new Float32Array([x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1]);
}

// One file: places and turns of joints over time.
class Take {
  constructor(packed) {
    Object.assign(this, packed);
    this.codes = decode(packed.places.data, Int16Array);
    this.quats = packed.turns && decode(packed.turns, Int16Array);
    this.count = packed.names.length;
    this.duration = Math.max(0, (packed.frames - 1) / packed.fps);
    this.shift = [0, 0, 0];
    this.feet = packed.contacts && {
      stands: decode(packed.contacts.stands, Uint8Array), places: decode(packed.contacts.places.data, Int16Array),
      offset: packed.contacts.places.offset, step: packed.contacts.places.step,
    };
    const side = (n) => /left|^l[_. ]|[_. ]l$|[_. ]l[_. ]|^L[A-Z]/i.test(n) && !/right/i.test(n) ? 1 : /right|^r[_. ]|[_. ]r$|[_. ]r[_. ]|^R[A-Z]/i.test(n) ? 2 : 0;
    this.sides = this.names.map(side);
  }
  frame(seconds) { return clamp(Math.floor(seconds * this.fps + 1e-4), 0, this.frames - 1); }
  place(t, j) {
    const at = 3 * (t * this.count + j), c = this.codes;
    if (c[at] === -32768) return null;
    const { offset, step } = this.places, s = this.shift;
    return [offset[0] + step * c[at] + s[0], offset[1] + step * c[at + 1] + s[1], offset[2] + step * c[at + 2] + s[2]];
  }
  foot(t, k) {
    const f = this.feet, at = 3 * (4 * t + k);
    if (!f.stands[4 * t + k] || f.places[at] === -32768) return null;
    return [0, 1].map((i) => f.offset[i] + f.step * f.places[at + i] + this.shift[i]).concat(this.contacts.floor);
  }
  quat(t, j) {
    const at = 4 * (t * this.count + j), q = this.quats;
    const v = [q[at], q[at + 1], q[at + 2], q[at + 3]], n = Math.hypot(...v) || 1;
    return v.map((x) => x / n);
  }
  // Rotation vector in degrees of a joint against its parent.
  turn(t, j) {
    const b = this.quat(t, j), p = this.parents[j], a = p < 0 ? [0, 0, 0, 1] : this.quat(t, p);
    let [x, y, z, w] = [
      a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1], a[3] * b[1] - a[1] * b[3] - a[2] * b[0] + a[0] * b[2],
      a[3] * b[2] - a[2] * b[3] - a[0] * b[1] + a[1] * b[0], a[3] * b[3] + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]];
    if (w < 0) [x, y, z, w] = [-x, -y, -z, -w];
    const n = Math.hypot(x, y, z), angle = 2 * Math.atan2(n, w) * 180 / Math.PI;
    return n < 1e-9 ? [0, 0, 0] : [x, y, z].map((v) => v * angle / n);
  }
  // Rows of world_from_joint times bind, of a mesh's joints: three texels each.
  bones(t, mesh, out) {
    for (let k = 0; k < mesh.used.length; k++) {
      const j = mesh.used[k], [x, y, z, w] = this.quat(t, j), place = this.place(t, j) || [0, 0, 0];
      const R = [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w), 1 - 2 * (x * x + z * z),
        2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)];
      for (let r = 0; r < 3; r++) for (let c = 0; c < 4; c++) {
        let sum = c === 3 ? place[r] : 0;
        for (let i = 0; i < 3; i++) sum += R[3 * r + i] * mesh.binds[12 * k + 4 * i + c];
        out[12 * k + 4 * r + c] = sum;
      }
    }
    return out;
  }
}
