"use strict";
(() => {
  const d = JSON.parse(document.getElementById("data").textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const shorts = (text) => new Int16Array(bytes(text).buffer);
  const points = shorts(d.points.data), loose = shorts(d.loose.data);
  const M = d.labels.length, L = d.loose.count, T = d.shown, MISSING = -32768;
  const cloud = document.getElementById("cloud"), map = document.getElementById("map");
  const slider = document.getElementById("frame"), at = document.getElementById("at"), play = document.getElementById("play");
  const names = document.getElementById("names"), hover = document.getElementById("hover");
  slider.max = T - 1;
  let yaw = 0.6, pitch = 0.15, zoom = 1, frame = 0, timer = 0, mouse = null;
  const style = getComputedStyle(document.documentElement);
  const [LEFT, RIGHT] = ["left", "right"].map((side) => style.getPropertyValue(`--${side}-on-dark`).trim());
  const colour = (side) => side === "L" ? LEFT : side === "R" ? RIGHT : "#9be28a";
  const place = (store, count, p, t, i) => {
    const k = (t * count + i) * 3;
    if (store[k] === MISSING) return null;
    return [0, 1, 2].map((c) => p.offset[c] + p.step * store[k + c]);
  };
  const centreOf = (t) => {
    let s = [0, 0, 0], n = 0;
    for (let i = 0; i < M; i++) { const p = place(points, M, d.points, t, i); if (p) { n++; for (let c = 0; c < 3; c++) s[c] += p[c]; } }
    return n ? s.map((v) => v / n) : d.points.offset;
  };
  function draw() {
    const w = cloud.clientWidth, h = cloud.clientHeight, ratio = window.devicePixelRatio || 1;
    cloud.width = w * ratio; cloud.height = h * ratio;
    const g = cloud.getContext("2d");
    g.scale(ratio, ratio);
    const c = centreOf(frame), scale = h / 2.3 * zoom;
    const screen = (p) => {
      const x = p[0] - c[0], y = p[1] - c[1], z = p[2] - c[2];
      const u = x * Math.cos(yaw) + y * Math.sin(yaw), v = -x * Math.sin(yaw) + y * Math.cos(yaw);
      return [w / 2 + u * scale, h / 2 - (z * Math.cos(pitch) + v * Math.sin(pitch)) * scale];
    };
    g.lineWidth = 1.5;
    const seen = d.labels.map((_, i) => { const p = place(points, M, d.points, frame, i); return p && screen(p); });
    for (const [a, b] of d.edges) if (seen[a] && seen[b]) {
      g.strokeStyle = "rgba(255,255,255,.28)"; g.beginPath(); g.moveTo(...seen[a]); g.lineTo(...seen[b]); g.stroke();
    }
    for (let i = 0; i < L; i++) {
      const p = place(loose, L, d.loose, frame, i);
      if (p) { const s = screen(p); g.fillStyle = "#fff"; g.fillRect(s[0] - 2, s[1] - 2, 4, 4); }
    }
    let near = null;
    seen.forEach((s, i) => {
      if (!s) return;
      g.fillStyle = colour(d.sides[i]); g.beginPath(); g.arc(s[0], s[1], 4.5, 0, 7); g.fill();
      if (d.state[frame][i] === "f") { g.strokeStyle = "#3f7fd0"; g.lineWidth = 2; g.stroke(); }
      if (names.checked) { g.fillStyle = "#fff"; g.font = "11px sans-serif"; g.fillText(d.labels[i], s[0] + 6, s[1] - 4); }
      if (mouse) { const q = Math.hypot(s[0] - mouse[0], s[1] - mouse[1]); if (q < 14 && (!near || q < near[0])) near = [q, i, s]; }
    });
    if (near && !names.checked) { g.fillStyle = "#fff"; g.font = "13px sans-serif"; g.fillText(d.labels[near[1]], near[2][0] + 8, near[2][1] - 6); }
    const real = frame * d.stride;
    at.textContent = `frame ${real}, ${(real / d.fps).toFixed(2)} s`;
    slider.value = frame;
    drawMap();
  }
  const TONES = { m: "#d9dde2", s: "#2e7d4f", u: "#e0a72e", d: "#c2453d", f: "#3f7fd0" };
  const row = 12;
  const picture = document.createElement("canvas");
  picture.width = T; picture.height = M;
  const pg = picture.getContext("2d");
  for (let t = 0; t < T; t++) for (let i = 0; i < M; i++) { pg.fillStyle = TONES[d.state[t][i]]; pg.fillRect(t, i, 1, 1); }
  function drawMap() {
    const w = map.clientWidth, ratio = window.devicePixelRatio || 1;
    map.style.height = `${M * row}px`;
    map.width = w * ratio; map.height = M * row * ratio;
    const g = map.getContext("2d");
    g.scale(ratio, ratio);
    g.imageSmoothingEnabled = false;
    g.drawImage(picture, 0, 0, T, M, 0, 0, w, M * row);
    g.strokeStyle = "rgba(255,255,255,.55)";
    for (let i = 1; i < M; i++) { g.beginPath(); g.moveTo(0, i * row); g.lineTo(w, i * row); g.stroke(); }
    g.strokeStyle = "#111"; g.lineWidth = 1.5; g.beginPath();
    const x = (frame + 0.5) / T * w; g.moveTo(x, 0); g.lineTo(x, M * row); g.stroke();
  }
  const list = document.getElementById("mapnames");
  list.style.gridAutoRows = `${row}px`;
  for (const label of d.labels) { const e = document.createElement("span"); e.textContent = label; list.append(e); }
  const go = (t) => { frame = Math.max(0, Math.min(T - 1, t)); draw(); };
  slider.oninput = () => go(+slider.value);
  names.onchange = draw;
  map.onclick = (e) => go(Math.floor(e.offsetX / map.clientWidth * T));
  play.onclick = () => {
    if (timer) { clearInterval(timer); timer = 0; play.textContent = "Play"; return; }
    play.textContent = "Stop";
    timer = setInterval(() => go(frame + 1 >= T ? 0 : frame + 1), 1000 * d.stride / Math.min(d.fps, 50));
  };
  let held = null;
  cloud.onpointerdown = (e) => { held = [e.clientX, e.clientY, yaw, pitch]; cloud.setPointerCapture(e.pointerId); };
  cloud.onpointerup = () => { held = null; };
  cloud.onpointermove = (e) => {
    mouse = [e.offsetX, e.offsetY];
    if (held) { yaw = held[2] - (e.clientX - held[0]) / 150; pitch = Math.max(-1.5, Math.min(1.5, held[3] + (e.clientY - held[1]) / 150)); }
    draw();
  };
  cloud.onwheel = (e) => { e.preventDefault(); zoom *= Math.exp(-e.deltaY / 600); draw(); };
  document.querySelectorAll("[data-frame]").forEach((e) => { e.onclick = () => { go(Math.round(+e.dataset.frame / d.stride)); cloud.scrollIntoView({ block: "center" }); }; });
  window.onresize = draw;
  draw();
})();
