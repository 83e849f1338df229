"""Processors, and work that is shared out among processes of their own."""

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
    """The numbers of those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def affordable(memory: float) -> int:
    """As many processes as there are processors, but no more than half of the machine's memory is enough for.

    Args:
        memory: bytes that one takes.
    """
    try:
        there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):  # a system that does not tell
        return len(processors())
    return max(1, min(len(processors()), int(there / 2 / memory)))


def shared_out(work: Callable[[_Item], _Result], items: Sequence[_Item], processes: int) -> Iterator[_Result]:
    """What `work` makes of each item, in the order in which it is done. They end with this process, however that ends.
    Where one of them is ended or crashes, which is said, one less goes on with what is not done.

    Args:
        work: has to pickle; each process has one copy of it for all its items. In this process where one is enough.
        items: have to pickle, and so do the results. One that was begun may be begun anew.
        processes: how many at most.

    Raises:
        SessionError: processes were ended until one alone was, before it had done anything.
    """
    processes = min(processes, len(items))
    if processes <= 1:
        yield from map(work, items)
        return
    left = dict(enumerate(items))
    while left:
        before, mine = len(left), set[BaseProcess]()
        try:
            for number, result in _in_pool(work, left, processes, mine):
                del left[number]
                yield result
        except BrokenProcessPool as error:
            ended = f"one of {processes} processes was ended{_by(mine)}"
            if processes == 1 and len(left) == before:
                raise SessionError(f"{ended}. What was whole stays") from error
            processes = max(1, processes - 1)
            print(f"note: {ended}; going on with {processes}", file=sys.stderr)


def _in_pool(
    work: Callable[[_Item], _Result], items: Mapping[int, _Item], processes: int, mine: set[BaseProcess]
) -> Iterator[tuple[int, _Result]]:
    """The items' numbers and what became of them; notes its processes in `mine`, which have all ended when it ends."""
    context, threads = multiprocessing.get_context("spawn"), max(1, len(processors()) // processes)
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(processes, context, _begin, (work, threads))
    try:
        with _without_main():
            numbers = {pool.submit(_do, item): number for number, item in items.items()}
        mine |= set(multiprocessing.active_children()) - others
        for done in as_completed(list(numbers)):
            yield numbers.pop(done), done.result()
    except BaseException:  # nobody waits for the rest
        for process in mine | set(multiprocessing.active_children()) - others:
            with contextlib.suppress(ProcessLookupError):  # it ended by itself
                if process.pid is not None:
                    os.kill(process.pid, signal.SIGINT)
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _by(processes: Iterable[BaseProcess]) -> str:
    """What ended them, in words, where that is known; of a pool that is shut down, which asks them itself: of two who
    ask at once one is not told."""
    for process in processes:
        # The pool ends those that are left when one has ended.
        if process.exitcode == -signal.SIGKILL:
            return ", perhaps for want of memory: fewer need less"
        if process.exitcode not in (None, 0, 1, -signal.SIGTERM, -signal.SIGINT):
            why = signal.strsignal(-process.exitcode) if process.exitcode < 0 else f"exit status {process.exitcode}"
            return f" ({why})"
    return ""


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Processes that are started within do not run the program's own file again, which may not expect it (no `if
    __name__ == "__main__"`) or be no file."""
    main = sys.modules["__main__"]
    file = {name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in main.__dict__}
    main.__spec__ = None
    try:
        yield
    finally:
        main.__dict__.update(**file)


@contextlib.contextmanager
def one_at_a_time(what: str) -> Iterator[None]:
    """Of a user's processes that have a name in common, one is in the block at a time; on systems without such locks
    all of them."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (pathlib.Path(tempfile.gettempdir()) / f"muybridge-{os.getuid()}-{what}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # until it is closed
        yield


_work: Callable[[Any], Any] | None = None  # of a process that `shared_out` started


def _begin(work: Callable[[Any], Any], threads: int) -> None:
    global _work
    _work = work
    os.environ.setdefault("LP_NUM_THREADS", str(threads))  # llvmpipe's, which takes all processors otherwise
    signal.signal(signal.SIGINT, _stop)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _stop(*_: object) -> None:
    """What is half written is removed, and nothing else begun."""
    global _work
    _work = None
    raise KeyboardInterrupt


def _do(item: Any) -> Any:
    if _work is None:
        raise KeyboardInterrupt
    return _work(item)
