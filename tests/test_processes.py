"""Work shared among threads."""

import gc
import multiprocessing
import threading

import pytest

from robodyn.system.processes import together, without_collections


def test_work_is_shared_and_the_first_share_is_the_callers():
    """All shares meet at a barrier: they run at a time."""
    barrier = threading.Barrier(5, timeout=60)

    def work(k):
        barrier.wait()
        return k, threading.get_ident()

    shares = together(work, 5)
    assert [k for k, _ in shares] == [0, 1, 2, 3, 4]
    assert shares[0][1] == threading.get_ident()
    assert len({thread for _, thread in shares}) == 5


@pytest.mark.parametrize("failing", [0, 1])
def test_whoever_fails_stops_the_others_and_is_waited_for(failing):
    stop, ended = threading.Event(), []

    def work(k):
        if k == failing:
            raise KeyboardInterrupt if k == 0 else ZeroDivisionError
        assert k == 0 or stop.wait(60)  # the first is the caller's, who looks at the others after it
        ended.append(k)

    with pytest.raises(KeyboardInterrupt if failing == 0 else ZeroDivisionError):
        together(work, 3, stop.set)
    assert sorted(ended) == sorted({0, 1, 2} - {failing})


def test_the_caller_hears_of_a_failure_while_at_work():
    stop = threading.Event()

    def work(k):
        if k:
            raise ZeroDivisionError
        assert stop.wait(60)

    with pytest.raises(ZeroDivisionError):
        together(work, 2, stop.set)


@pytest.mark.parametrize("enabled", [True, False])
def test_the_search_for_garbage_is_left_as_it_was(enabled):
    def failing():
        assert not gc.isenabled()
        raise ZeroDivisionError

    (gc.enable if enabled else gc.disable)()
    try:
        assert without_collections(gc.isenabled)() is False
        assert gc.isenabled() == enabled
        with pytest.raises(ZeroDivisionError):
            without_collections(failing)()
        assert gc.isenabled() == enabled
    finally:
        gc.enable()


def test_a_forked_child_has_threads_of_its_own():
    assert together(abs, 3) == [0, 1, 2]
    context = multiprocessing.get_context("fork")
    process = context.Process(target=lambda: together(abs, 3), daemon=True)
    process.start()
    process.join(60)
    assert process.exitcode == 0
