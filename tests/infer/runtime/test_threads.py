"""Libraries that would start threads of their own are kept from it."""

import os
import subprocess
import sys

import cv2

from muybridge.infer.runtime.threads import opencv_in_one_thread


def test_opencv_runs_in_one_thread_and_gets_its_threads_back() -> None:
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        with opencv_in_one_thread():
            assert cv2.getNumThreads() == 1
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)


def test_the_command_line_keeps_blas_from_starting_threads() -> None:
    """The variable is read when numpy is loaded: nothing that the command line imports first may load it."""
    code = (
        "import sys, os; import muybridge.infer.commands.app as app; assert 'numpy' not in sys.modules\n"
        "app.run_command = lambda argv: print(os.environ['OPENBLAS_NUM_THREADS']) or 0\n"
        "app.main([])"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    for chosen in (None, "3"):
        extra = {} if chosen is None else {"OPENBLAS_NUM_THREADS": chosen}
        done = subprocess.run([sys.executable, "-c", code], env=environment | extra, capture_output=True, text=True)
        assert (done.returncode, done.stdout.strip()) == (0, chosen or "1"), done.stderr
