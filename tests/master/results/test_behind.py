"""Calls behind the run: their order, their limit, their errors; and objects that are lent to them."""

from __future__ import annotations

import threading

import pytest

from cosim_master.results.recording.behind import Behind, Lent

LIMIT = 300.0
"""Wall-clock seconds after which a wait has failed."""


def test_calls_are_made_in_their_order_in_another_thread() -> None:
    behind, made = Behind("calls", 3), list[tuple[int, bool]]()
    for i in range(50):
        behind.call(lambda i=i: made.append((i, threading.current_thread() is threading.main_thread())))
    behind.wait()
    assert made == [(i, False) for i in range(50)]
    behind.stop()


def test_no_more_calls_wait_than_the_limit() -> None:
    behind, go, accepted = Behind("calls", 2), threading.Event(), threading.Event()

    def give() -> None:
        behind.call(go.wait)
        behind.call(lambda: None)
        accepted.set()
        behind.call(lambda: None)  # waits for the first
        fourth.set()

    fourth = threading.Event()
    giving = threading.Thread(target=give)
    giving.start()
    assert accepted.wait(LIMIT)
    assert not fourth.wait(0.05)
    go.set()
    assert fourth.wait(LIMIT)
    giving.join()
    behind.stop()


def test_an_exception_is_raised_once_and_later_calls_are_made() -> None:
    behind, made = Behind("calls", 8), list[int]()

    def fail() -> None:
        raise ZeroDivisionError

    behind.call(fail)
    behind._calls[0].exception(LIMIT)
    with pytest.raises(ZeroDivisionError):
        behind.call(lambda: None)
    behind.call(lambda: made.append(1))
    behind.wait()
    assert made == [1]
    behind.stop()


def test_stopping_makes_the_calls_that_wait() -> None:
    behind, made = Behind("calls", 100), list[int]()
    for i in range(20):
        behind.call(lambda i=i: made.append(i))
    behind.stop()
    assert made == [*range(20)]


def test_the_object_given_back_last_is_lent_first() -> None:
    numbers = iter(range(9))
    lent = Lent(lambda: next(numbers), 3)
    assert [lent.take(), lent.take()] == [0, 1]
    lent.give_back(1)
    lent.give_back(0)
    assert [lent.take(), lent.take(), lent.take()] == [0, 1, 2]
    timer = threading.Timer(0.05, lent.give_back, [2])  # no fourth is made: `take` waits
    timer.start()
    assert lent.take() == 2
    timer.join()
