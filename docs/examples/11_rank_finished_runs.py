"""Sort the results of many sessions by quality, worst first, from their `run.json` alone.

    python 11_rank_finished_runs.py RESULTS

For the folder of `muybridge run takes/* --out RESULTS`. Needs nothing but Python.
"""

import json
import sys
from pathlib import Path

runs = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(Path(sys.argv[1]).rglob("run.json"))]


def worry(run: dict) -> tuple:
    """The more problems first, then the larger error."""
    return -len(run["problems"]), -run["quality"]["leave_one_out_px"]


for run in sorted(runs, key=worry):
    quality = run["quality"]
    print(f"{run['session']['name']}: coverage {quality['coverage']:.1%}, "
          f"leave-one-camera-out {quality['leave_one_out_px']:.1f} px")  # fmt: skip
    worst = max(quality["cameras"], key=lambda name: quality["cameras"][name]["leave_one_out_px"])
    print(f"  agrees least: {worst}")
    for sentence in run["problems"]:
        print(f"  problem: {sentence}")
