"""Progress of a long step: reported to the registered listeners, by default none."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

FIRST_USE = "first use"  # begins the stage that a fresh machine needs and others do not
Listener = Callable[[str, int, int], None]
T = TypeVar("T")

_listeners: list[Listener] = []


@contextmanager
def progress_to(listener: Listener) -> Iterator[None]:
    """Within this context the listener receives each report: (stage, steps done, steps in total)."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def report_progress(stage: str, done: int, total: int) -> None:
    """Report the progress of a stage; it is complete when done equals the total.

    Other threads than the main one report nothing: a bar shows one stage at a time.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for listener in _listeners:
        listener(stage, done, total)


def counted(stage: str, items: Iterable[T], total: int) -> Iterator[T]:
    """The items, each reported as it comes; a stage that ends early is reported as complete."""
    done = 0
    if total > 0:
        report_progress(stage, 0, total)
    try:
        for item in items:
            done += 1
            if done < total:
                report_progress(stage, done, total)
            yield item
    finally:
        if total > 0:
            report_progress(stage, total, total)
