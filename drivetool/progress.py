"""How far a long step has come: told to whoever shows it, by default to nobody."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Listener = Callable[[str, int, int], None]
T = TypeVar("T")

_listeners: list[Listener] = []


@contextmanager
def shown_by(listener: Listener) -> Iterator[None]:
    """Within this, what is told reaches the listener: (stage, steps done, steps in all)."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def tell(stage: str, done: int, total: int) -> None:
    """Say how far a stage is; it is over when done reaches the total.

    What runs beside the main thread says nothing: a bar shows one stage at a time.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for listener in _listeners:
        listener(stage, done, total)


def counted(stage: str, items: Iterable[T], total: int) -> Iterator[T]:
    """The items, each told as it comes; a stage that ends early is over all the same."""
    done = 0
    if total > 0:
        tell(stage, 0, total)
    try:
        for item in items:
            done += 1
            if done < total:
                tell(stage, done, total)
            yield item
    finally:
        if total > 0:
            tell(stage, total, total)
