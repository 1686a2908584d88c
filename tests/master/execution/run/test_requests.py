"""Requests to end a run: what one signal, two at once, and two in turn do."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a function in C for Linux")

PROGRAM = """
import os, signal, sys, time
from cosim_master.execution.run.faults.requests import TOGETHER, handled
received = []
handled(signal.SIGTERM, lambda number, frame: received.append(number))
for pause in map(float, sys.argv[1:]):
    time.sleep(pause * TOGETHER)
    os.kill(os.getpid(), signal.SIGTERM)
    print(len(received), flush=True)
"""


def run(*pauses: str) -> subprocess.CompletedProcess[str]:
    """A process that sends itself signals after pauses, in multiples of TOGETHER, and prints how many were handled."""
    return subprocess.run([sys.executable, "-c", PROGRAM, *pauses], capture_output=True, text=True, check=False)


def test_signals_at_once_are_one_request() -> None:
    """timeout(1) sends each to the process and to its group."""
    assert (done := run("0", "0", "0")).returncode == 0, done.stderr
    assert done.stdout.split() == ["1", "2", "3"]


def test_the_second_request_ends_the_process() -> None:
    """As if an FMU kept Python from running: the handler has not asked for another one."""
    done = run("0", "0", "1.5", "0")
    assert (done.returncode, done.stdout.split()) == (-signal.SIGTERM, ["1", "2"])


def test_a_signal_without_a_handler_is_left_alone() -> None:
    program = "import signal\nfrom cosim_master.execution.run.faults.requests import expected\n"
    program += "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
    program += "print(expected(signal.SIGTERM), expected(signal.SIGHUP), expected(signal.SIGINT))\n"
    program += "print(signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False", "True", "True"]


def test_without_the_function_in_c_the_second_signal_ends_the_process() -> None:
    program = "from cosim_master.execution.run.faults import requests\nrequests._functions = lambda: None\n" + PROGRAM
    done = subprocess.run([sys.executable, "-c", program, "0", "0"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (-signal.SIGTERM, ["1"])


OF_AN_FMU = """
import ctypes, os, signal
from cosim_master.execution.run.faults.requests import behind, expected
received = []
HANDLER = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
def noted(number, information, context):
    received.append((number, ctypes.c_int.from_address(information).value))  # si_signo
handler = HANDLER(noted)
class Action(ctypes.Structure):  # struct sigaction of glibc
    _fields_ = [("handler", HANDLER), ("mask", ctypes.c_ubyte * 128), ("flags", ctypes.c_int), ("end", ctypes.c_void_p)]
libc = ctypes.CDLL(None)
assert libc.sigaction(15, ctypes.byref(Action(handler=handler, flags=4)), None) == 0  # SA_SIGINFO
place = ctypes.cast(handler, ctypes.c_void_p).value
print(expected(15))
found = (ctypes.c_void_p * 32)()
libc.sigaction(15, None, found)
os.kill(os.getpid(), 15)
print(found[0] == place, behind(15, found[0]) == place, received)
"""


def test_a_handler_that_an_fmu_has_set_gets_all_that_the_system_tells() -> None:
    """A handler of three parameters reads what they point to."""
    done = subprocess.run([sys.executable, "-c", OF_AN_FMU], capture_output=True, text=True, check=False)
    assert (done.stdout.split("\n"), done.stderr) == (["True", "False True [(15, 15)]", ""], "")
