"""Frames per second of the page of `muybridge match play` in headless Chromium, steered by keys.

Usage: python -m scripts.benchmarks.motion.match_page PAGE.html [--seconds 12] [--runs 2] [--size 1280x800]
    [--flags "--disable-gpu"] [--chromium PATH]

The page is served from this machine with a script that holds keys, notes errors and sends what the page itself counts:
every half second the frames per second, the milliseconds that its script takes a frame, and the share of the pixels a
side that it draws. The first three seconds, in which the page is laid out and finds its resolution, are given apart.
Other processes on the machine count: run it on an idle one.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import tempfile
import threading
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np

_SETTLING_S = 3.0
_LATE_S = 60.0  # beyond the measured seconds, for Chromium to start and the page to be read
_ERRORS = """<script>window.noted = [];
addEventListener("error", (e) => window.noted.push(String(e.message)));
addEventListener("unhandledrejection", (e) => window.noted.push(String(e.reason)));
const told = console.error; console.error = (...words) => { window.noted.push(words.join(" ")); told(...words); };
</script>"""
_STEER = """<script>{
const root = document.querySelector(".steering"), rows = [], begun = performance.now(), send = (body) =>
  fetch("/done", { method: "POST", body: JSON.stringify(body) });
const keys = ["KeyW", "KeyA", "KeyW", "KeyD"];
let held = null, turn = 0;
const press = (kind, code) => document.dispatchEvent(new KeyboardEvent(kind, { code, bubbles: true }));
const change = () => { if (held) press("keyup", held); held = keys[turn++ % keys.length]; press("keydown", held); };
change(); setInterval(change, 1500);
setInterval(() => rows.push([(performance.now() - begun) / 1000, Number(root.dataset.fps), Number(root.dataset.ms),
  Number(root.dataset.detail)]), 500);
setTimeout(() => send({ rows, errors: window.noted, state: root.dataset.state }), 1000 * SECONDS);
}</script>"""


class _Page(BaseHTTPRequestHandler):
    """Serves one page, and takes what it sends."""

    def __init__(self, page: bytes, answers: list[dict], done: threading.Event, *rest: object) -> None:
        self.page, self.answers, self.done = page, answers, done
        super().__init__(*rest)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        found = self.path == "/"
        self.send_response(200 if found else 204)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        if found:
            self.wfile.write(self.page)

    def do_POST(self) -> None:
        self.answers.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()
        self.done.set()

    def log_message(self, *words: object) -> None:
        pass


def measured(page: Path, seconds: float, size: str, flags: list[str], chromium: str) -> dict:
    """What one visit of the page sends: `rows` of (s, frames/s, ms, detail), `errors` and `state`."""
    text = page.read_text(encoding="utf-8").replace("<head>", "<head>" + _ERRORS, 1)
    text = text.replace("</body>", _STEER.replace("SECONDS", f"{seconds:g}") + "</body>", 1)
    answers: list[dict] = []
    done = threading.Event()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Page, text.encode(), answers, done))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [chromium, "--headless=new", "--no-sandbox", "--no-first-run", f"--user-data-dir={profile}", *flags,
                   f"--window-size={size.replace('x', ',')}", f"http://127.0.0.1:{server.server_port}/"]  # fmt: skip
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            done.wait(seconds + _LATE_S)
        finally:
            browser.terminate()
            browser.wait()
            server.shutdown()
    if not answers:
        raise SystemExit(f"{page}: nothing came back from {chromium} within {seconds + _LATE_S:g} s")
    return answers[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", type=Path, nargs="+", help="several are visited in turn, to compare them")
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--flags", default="--disable-gpu", help="of Chromium")
    parser.add_argument("--chromium", default=shutil.which("chromium") or "chromium")
    options = parser.parse_args()
    for run in range(options.runs):
        for page in options.pages:
            told = measured(page, options.seconds, options.size, options.flags.split(), options.chromium)
            rows = np.array(told["rows"], dtype=np.float64)
            first, rest = (rows[k] for k in (rows[:, 0] <= _SETTLING_S, rows[:, 0] > _SETTLING_S))
            fps = rest[:, 1]
            print(f"{page.name}, run {run + 1}: {np.nanmedian(fps):.0f} frames/s ({np.nanmin(fps):.0f} to "
                  f"{np.nanmax(fps):.0f}; before {_SETTLING_S:g} s {np.nanmedian(first[:, 1]):.0f}), script "
                  f"{np.nanmedian(rest[:, 2]):.2f} ms a frame, detail {rest[-1, 3]:.2f}, {told['state']}, "
                  f"{len(told['errors'])} errors {told['errors'][:3]}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
