// Player, timeline and the page's buttons. `View` is in report_view.js.
(() => {
  const scene = JSON.parse(document.getElementById("data").textContent);
  const byId = (id) => document.getElementById(id);
  const view = new View(byId("view"), scene);
  const scrub = byId("scrub"), play = byId("play"), timeline = byId("timeline");
  let frame = 0, playing = false, started = null;

  // ---- frames: the slider counts the take's frames, the view every `stride`-th of them
  function goTo(t) {
    frame = clamp(Math.round(t), 0, scene.frames - 1);
    view.t = Math.floor(frame / scene.stride);
    scrub.value = frame;
    byId("clock").textContent = `${(frame / scene.fps).toFixed(2)} s`;
    view.draw();
    drawTimeline();
  }
  view.onchange = (points) => {
    const lacking = scene.landmarks.names.filter((_, j) => !points[j]).map((n) => n.replaceAll("_", " "));
    const hud = byId("hud");
    hud.textContent = `frame ${frame} of ${scene.frames - 1}`;
    if (lacking.length) {
      const span = document.createElement("span");
      span.className = "lack";
      span.textContent = "\nmissing: " + (lacking.length > 5 ? `${lacking.length} of ${points.length} landmarks` : lacking.join(", "));
      hud.append(span);
    }
  };
  function setPlaying(on) {
    playing = on;
    started = null;
    play.textContent = on ? "❚❚" : "▶";
    play.setAttribute("aria-label", on ? "Pause" : "Play");
    if (on) requestAnimationFrame(tick);
  }
  function tick(now) {
    if (!playing) return;
    if (started === null) started = { now, frame };
    const elapsed = ((now - started.now) / 1000) * scene.fps * Number(byId("speed").value);
    goTo((started.frame + elapsed) % scene.frames);
    requestAnimationFrame(tick);
  }
  const jump = (t) => { setPlaying(false); goTo(t); };

  scrub.max = scene.frames - 1;
  scrub.addEventListener("input", () => jump(Number(scrub.value)));
  play.addEventListener("click", () => setPlaying(!playing));
  byId("speed").addEventListener("change", () => { started = null; });
  for (const button of document.querySelectorAll(".jump")) {
    button.addEventListener("click", () => {
      jump(Number(button.dataset.frame));
      byId("scene").scrollIntoView({ block: "nearest", behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
    });
  }

  // ---- what is shown, and from where
  for (const radio of document.querySelectorAll("input[name=what]")) {
    radio.addEventListener("change", () => {
      view.show.points = radio.value !== "joints";
      view.show.joints = radio.value !== "points";
      view.draw();
    });
    if (!scene.joints) { radio.disabled = radio.value !== "points"; radio.checked = radio.value === "points"; }
  }
  for (const name of ["cameras", "trails", "names", "follow"]) {
    byId(name).addEventListener("change", (event) => { view.show[name] = event.target.checked; view.draw(); });
  }
  const from = byId("from");
  const options = [["free", "Free view"], ["room", "Whole room"], ["front", "Front"], ["left", "Their left"], ["right", "Their right"], ["back", "Back"], ["top", "Above"]];
  for (const [value, text] of options.concat(scene.cameras.map((c) => ["camera:" + c.name, c.name]))) from.add(new Option(text, value));
  from.addEventListener("change", () => view.lookFrom(from.value));
  view.onleave = () => { from.value = "free"; };

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const typing = event.target.closest("input, select, button, summary, a");
    const inView = event.target === view.canvas;
    const keys = {
      " ": () => setPlaying(!playing),
      ArrowLeft: () => jump(frame - (event.shiftKey ? 10 : 1)), ArrowRight: () => jump(frame + (event.shiftKey ? 10 : 1)),
      Home: () => jump(0), End: () => jump(scene.frames - 1),
    };
    const viewKeys = {
      a: () => view.turn(-12, 0), d: () => view.turn(12, 0), w: () => view.turn(0, 12), s: () => view.turn(0, -12),
      "+": () => view.zoom(0.9), "=": () => view.zoom(0.9), "-": () => view.zoom(1.1),
      0: () => { view.reset(); view.onleave(); view.draw(); },
    };
    if (typing) return;
    const action = viewKeys[event.key.toLowerCase()] || ((inView || !["Home", "End"].includes(event.key)) && keys[event.key]);
    if (action) { event.preventDefault(); action(); }
  });

  // ---- timeline: one row a camera, then one a landmark
  const line = scene.timeline, columns = line.first.length, landmarkCount = scene.landmarks.names.length;
  const missing = decodeBytes(line.missing), agreeing = decodeBytes(line.cameras);
  const residuals = line.residual.flat().filter((v) => v !== null).sort((a, b) => a - b);
  const cap = Math.max(1, 2.5 * (residuals[Math.floor(residuals.length / 2)] || 1));
  const rows = [
    ...scene.cameras.map((camera, c) => ({ label: camera.name, camera: c })),
    ...scene.landmarks.names.map((name, j) => ({ label: name.replaceAll("_", " "), landmark: j })),
  ];
  let layout = null, still = null;

  function layOut() {
    const width = timeline.parentElement.clientWidth, left = width < 560 ? 92 : 118;
    const high = 22, low = 13, between = 12;
    let y = 4;
    for (const row of rows) {
      if (row.landmark === 0) y += between;
      row.y = y;
      row.height = row.camera !== undefined ? high : low;
      y += row.height + 2;
    }
    layout = { width, left, right: 10, height: y + 24 };
  }
  const columnX = (t) => layout.left + (t / scene.frames) * (layout.width - layout.left - layout.right);

  function drawStill() {
    layOut();
    const ratio = window.devicePixelRatio || 1;
    still = document.createElement("canvas");
    still.width = Math.round(layout.width * ratio);
    still.height = Math.round(layout.height * ratio);
    const g = still.getContext("2d");
    g.scale(ratio, ratio);
    g.font = "12px system-ui, sans-serif";
    g.textBaseline = "middle";
    g.textAlign = "right";
    for (const row of rows) {
      g.fillStyle = view.colour.text;
      g.fillText(row.label, layout.left - 8, row.y + row.height / 2 + 0.5);
      for (let b = 0; b < columns; b++) {
        const end = b + 1 < columns ? line.first[b + 1] : scene.frames;
        const x = columnX(line.first[b]), w = Math.max(columnX(end) - x, 0.6) + 0.3;
        if (row.camera !== undefined) {
          const value = line.residual[row.camera][b];
          if (value === null) { block(g, x, row.y, w, row.height, view.colour.missing); continue; }
          const h = Math.max(1, row.height * Math.min(value / cap, 1));
          g.fillStyle = view.colour.heat;
          g.fillRect(x, row.y + row.height - h, w, h);
        } else {
          const at = b * landmarkCount + row.landmark, lost = missing[at] / 100;
          const h = row.height * (agreeing[at] / 100) * (1 - lost);
          g.fillStyle = view.colour.bar;
          g.fillRect(x, row.y + row.height - h, w, h);
          if (lost > 0) block(g, x, row.y, w, Math.max(2, row.height * lost), view.colour.missing);
        }
      }
      g.fillStyle = view.colour.line;
      g.fillRect(layout.left, row.y + row.height, layout.width - layout.left - layout.right, 0.7);
    }
    drawAxis(g);
  }
  function block(g, x, y, w, h, colour) { g.fillStyle = colour; g.fillRect(x, y, w, h); }
  function drawAxis(g) {
    const seconds = scene.frames / scene.fps, most = (layout.width - layout.left) / 70;
    const step = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600].find((s) => seconds / s <= most) || 1200;
    g.fillStyle = view.colour.soft;
    g.textAlign = "center";
    for (let k = 0; k * step <= seconds + 1e-9; k++) {
      const x = columnX(k * step * scene.fps);
      g.fillRect(x, layout.height - 22, 1, 5);
      g.fillText(`${Number((k * step).toFixed(2))} s`, clamp(x, layout.left + 10, layout.width - 20), layout.height - 9);
    }
  }
  function drawTimeline() {
    if (!still) return;
    timeline.width = still.width;
    timeline.height = still.height;
    timeline.style.height = `${layout.height}px`;
    const g = timeline.getContext("2d"), ratio = still.width / layout.width;
    g.drawImage(still, 0, 0);
    g.scale(ratio, ratio);
    g.fillStyle = view.colour.text;
    g.fillRect(columnX(frame + 0.5) - 0.75, 0, 1.5, layout.height - 20);
  }
  function frameAt(event) {
    const x = event.clientX - timeline.getBoundingClientRect().left;
    return clamp(Math.floor(((x - layout.left) / (layout.width - layout.left - layout.right)) * scene.frames), 0, scene.frames - 1);
  }
  function read(event) {
    const y = event.clientY - timeline.getBoundingClientRect().top, t = frameAt(event);
    const row = rows.find((r) => y >= r.y && y < r.y + r.height + 2);
    let b = line.first.findIndex((first) => first > t);
    b = (b < 0 ? columns : b) - 1;
    let text = `frame ${t}, ${(t / scene.fps).toFixed(2)} s`;
    if (row && row.camera !== undefined) {
      const value = line.residual[row.camera][b];
      text += ` · ${row.label}: ${value === null ? "no 2D points" : value.toFixed(1) + " px off in the median"}`;
    } else if (row) {
      const at = b * landmarkCount + row.landmark, count = (agreeing[at] / 100) * scene.cameras.length;
      text += ` · ${row.label}: ${missing[at] === 100 ? "missing" : scene.cameras.length ? `${Number(count.toFixed(1))} of ${scene.cameras.length} cameras agree` : "known"}`;
    }
    byId("readout").textContent = text;
  }
  timeline.addEventListener("pointerdown", (event) => { timeline.setPointerCapture(event.pointerId); jump(frameAt(event)); read(event); });
  timeline.addEventListener("pointermove", (event) => { read(event); if (event.buttons & 1) jump(frameAt(event)); });

  function restyle() { view.readColours(); drawStill(); view.draw(); drawTimeline(); }
  new ResizeObserver(() => requestAnimationFrame(() => {
    if (!layout || layout.width !== timeline.parentElement.clientWidth) { drawStill(); drawTimeline(); }
  })).observe(timeline.parentElement);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", restyle);
  addEventListener("beforeprint", () => { document.documentElement.dataset.theme = "light"; restyle(); });
  addEventListener("afterprint", () => { delete document.documentElement.dataset.theme; restyle(); });

  // Begin at the frame nearest to the middle that has most landmarks.
  const count = (t) => view.landmarks.track.frame(t).filter(Boolean).length;
  const shown = Math.ceil(scene.frames / scene.stride), middle = Math.floor(shown / 2);
  let best = middle, most = count(middle);
  for (let k = 1; k < Math.min(middle, 300) && most < landmarkCount; k++)
    for (const t of [middle - k, middle + k]) if (t < shown && count(t) > most) { best = t; most = count(t); }
  drawStill();
  goTo(best * scene.stride);
  document.documentElement.dataset.ready = "yes";
})();
