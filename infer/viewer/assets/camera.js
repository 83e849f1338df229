"use strict";
// A camera that turns about a target by pointer, finger and wheel; and the floor under it.
const FOV = 0.75; // radians, of the view's height

class Orbit {
  constructor() { this.yaw = -1.1; this.pitch = 0.2; this.distance = 3; this.height = 1; this.pan = [0, 0, 0]; }
  reset() {}
  listenCamera(stage) {
    const fingers = new Map();
    stage.addEventListener("pointerdown", (e) => { stage.setPointerCapture(e.pointerId); fingers.set(e.pointerId, [e.clientX, e.clientY]); });
    for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, (e) => fingers.delete(e.pointerId));
    stage.addEventListener("pointermove", (e) => {
      const before = fingers.get(e.pointerId);
      if (!before) return;
      const now = [e.clientX, e.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
      if (fingers.size > 1) {
        const other = [...fingers].find(([id]) => id !== e.pointerId)[1];
        const was = Math.hypot(before[0] - other[0], before[1] - other[1]), is = Math.hypot(now[0] - other[0], now[1] - other[1]);
        this.zoom(was / Math.max(is, 1)); this.move(dx / 2, dy / 2);
      } else if (e.buttons & 6 || e.shiftKey) this.move(dx, dy);
      else { this.yaw -= 0.008 * dx; this.pitch = clamp(this.pitch + 0.008 * dy, -1.5, 1.5); }
      fingers.set(e.pointerId, now); this.dirty = true;
    });
    stage.addEventListener("wheel", (e) => { this.zoom(Math.exp(0.001 * clamp(e.deltaY, -300, 300))); e.preventDefault(); }, { passive: false });
    stage.addEventListener("contextmenu", (e) => e.preventDefault());
    stage.addEventListener("dblclick", () => this.reset());
  }
  zoom(factor) { this.distance = clamp(this.distance * factor, 0.1 * this.height, 50 * this.height); this.dirty = true; }
  move(dx, dy) {
    const s = this.distance * 0.8 / (this.$("stage").clientHeight || 1), right = [-Math.sin(this.yaw), Math.cos(this.yaw), 0];
    this.pan = this.pan.map((v, i) => v - s * dx * right[i] + (i === 2 ? s * dy : 0));
  }
  // Matrix and place of the camera that looks at a target, for a picture of a size in pixels.
  look(target, size) {
    const far = Math.cos(this.pitch) * this.distance;
    const eye = [target[0] + far * Math.cos(this.yaw), target[1] + far * Math.sin(this.yaw), target[2] + this.distance * Math.sin(this.pitch)];
    return { eye, view: product(perspective(FOV, size[0] / size[1], 0.02 * this.distance, 60 * this.distance), lookAt(eye, target)) };
  }
  grid(target) {
    const lines = [], step = this.height > 40 ? 10 : this.height < 0.3 ? 0.1 : 1, reach = 8;
    const x = Math.round(target[0] / step), y = Math.round(target[1] / step), colour = [0.27, 0.3, 0.34, 1];
    for (let k = -reach; k <= reach; k++) {
      lines.push([[(x + k) * step, (y - reach) * step, 0], [(x + k) * step, (y + reach) * step, 0], colour]);
      lines.push([[(x - reach) * step, (y + k) * step, 0], [(x + reach) * step, (y + k) * step, 0], colour]);
    }
    return lines;
  }
}
