"""Jobs in threads that stop together, and libraries without threads of their own."""

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeVar

import cv2

_T = TypeVar("_T")


def in_threads(jobs: Sequence[Callable[[], _T]], workers: int, stop: threading.Event) -> list[_T]:
    """Run jobs in threads.

    The first failure, or Ctrl-C, sets `stop`, at which the other jobs have to raise `Stopped`.

    Args:
        jobs: to run.
        workers: number of threads.
        stop: is set when the jobs have ended or should end.

    Returns:
        The jobs' results.

    Raises:
        Exception: that of the first job that failed.
    """
    with ThreadPoolExecutor(max_workers=workers) as pool:
        futures: list[Future[_T]] = [pool.submit(job) for job in jobs]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
        finally:
            stop.set()
            for future in futures:
                future.cancel()
    errors = [f.exception() for f in futures if f.done() and not f.cancelled()]
    for error in errors:
        if error is not None and not isinstance(error, Stopped):
            raise error
    return [future.result() for future in futures]


@contextmanager
def opencv_in_one_thread() -> Iterator[None]:
    """Keep OpenCV from starting threads of its own: cameras run in parallel already, and its threads spin while they
    wait for work. (The command line does the same to BLAS, which has to be told before numpy is loaded.)"""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


class Stopped(Exception):
    """Another camera failed, or the user stopped the run."""
