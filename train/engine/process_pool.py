"""Processors, and work distributed among child processes."""

import contextlib
import multiprocessing
import os
import pathlib
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from muybridge.errors import SessionError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def processors() -> list[int]:
    """Numbers of the processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def affordable_processes(memory: float) -> int:
    """One process per processor, but no more than fit into half of the machine's memory.

    Args:
        memory: bytes per process.
    """
    try:
        total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):  # unknown on this system
        return len(processors())
    return max(1, min(len(processors()), int(total / 2 / memory)))


def map_in_processes(work: Callable[[_Item], _Result], items: Sequence[_Item], processes: int) -> Iterator[_Result]:
    """Results of `work` for each item, in order of completion.

    The child processes end with this process, in whatever way it ends. If one of them is killed or crashes, that is
    reported, and one process fewer continues with the remaining items.

    Args:
        work: must be picklable; each process has one copy of it for all its items. Called in this process if one is
            enough.
        items: must be picklable, as must the results. An interrupted item may be started again.
        processes: number of processes at most.

    Raises:
        SessionError: processes were killed until the last one was, before it had finished anything.
    """
    processes = min(processes, len(items))
    if processes <= 1:
        yield from map(work, items)
        return
    left = dict(enumerate(items))
    while left:
        before, own = len(left), set[BaseProcess]()
        try:
            for number, result in _in_pool(work, left, processes, own):
                del left[number]
                yield result
        except BrokenProcessPool as error:
            event = f"one of {processes} processes was terminated{_cause(own)}"
            if processes == 1 and len(left) == before:
                raise SessionError(f"{event}. Finished results are kept") from error
            processes = max(1, processes - 1)
            print(f"note: {event}; continuing with {processes}", file=sys.stderr)


def _in_pool(
    work: Callable[[_Item], _Result], items: Mapping[int, _Item], processes: int, own: set[BaseProcess]
) -> Iterator[tuple[int, _Result]]:
    """Numbers and results of the items; adds its processes to `own`, which have all ended when this generator ends."""
    context, threads = multiprocessing.get_context("spawn"), max(1, len(processors()) // processes)
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, context, _initialise, (work, threads))
    try:
        with _without_main():
            numbers = {pool.submit(_run, item): number for number, item in items.items()}
        own |= set(multiprocessing.active_children()) - others
        for done in as_completed(list(numbers)):
            yield numbers.pop(done), done.result()
    except BaseException:  # the other results are not wanted any more
        for process in own | set(multiprocessing.active_children()) - others:
            with contextlib.suppress(ProcessLookupError):  # it has ended already
                if process.pid is not None:
                    os.kill(process.pid, signal.SIGINT)
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _cause(processes: Iterable[BaseProcess]) -> str:
    """Why processes ended, in words, if known.

    Only for a pool that has been shut down: the pool collects exit codes too, and an exit code can be collected once.
    """
    for process in processes:
        # When one has ended, the pool terminates the others (SIGTERM).
        if process.exitcode == -signal.SIGKILL:
            return ", perhaps because memory ran out: fewer processes need less"
        if process.exitcode not in (None, 0, 1, -signal.SIGTERM, -signal.SIGINT):
            why = signal.strsignal(-process.exitcode) if process.exitcode < 0 else f"exit status {process.exitcode}"
            return f" ({why})"
    return ""


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Keep processes that are started inside the block from running the main program's file again, which may lack `if
    __name__ == "__main__"` or not be a file at all."""
    main = sys.modules["__main__"]
    file = {name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in main.__dict__}
    main.__spec__ = None
    try:
        yield
    finally:
        main.__dict__.update(**file)


@contextlib.contextmanager
def exclusive(name: str) -> Iterator[None]:
    """Let only one of a user's processes at a time run a block of this `name`; no restriction on systems without file
    locks."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (pathlib.Path(tempfile.gettempdir()) / f"muybridge-{os.getuid()}-{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # released when the file is closed
        yield


_work: Callable[[Any], Any] | None = None  # set in processes that `map_in_processes` started


def _initialise(work: Callable[[Any], Any], threads: int) -> None:
    global _work
    _work = work
    os.environ.setdefault("LP_NUM_THREADS", str(threads))  # of llvmpipe, which uses all processors by default
    signal.signal(signal.SIGINT, _stop)
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _stop(*_: object) -> None:
    """Interrupt the current item, whose half-written files are then removed, and start no other."""
    global _work
    _work = None
    raise KeyboardInterrupt


def _run(item: Any) -> Any:
    if _work is None:
        raise KeyboardInterrupt
    return _work(item)
