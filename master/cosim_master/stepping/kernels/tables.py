"""The data of the stepping loop: a plan of flat arrays, the types of their rows, and the codes in them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim_master.network.roles import declared

__all__ = [
    "AHEAD",
    "ANSWERS",
    "BASE",
    "BEGIN",
    "BLOCK",
    "BLOCK_FULL",
    "BY_PYTHON",
    "COMPLETED",
    "COPY",
    "DELAY",
    "DELIVER",
    "DONE",
    "DO_STEP",
    "EARLY",
    "END",
    "ENDED",
    "EVENTFUL",
    "EVENTS_DUE",
    "EVERY",
    "EXPECTING",
    "FAILED",
    "FAILURES",
    "FATAL",
    "FAULTS",
    "FEED",
    "FINAL",
    "FINER",
    "FROM",
    "GET_REAL",
    "GET_STRING",
    "GROUP",
    "INBOX",
    "INSTANCE",
    "IN_ORDER",
    "JACOBI",
    "K",
    "LAST",
    "LEFT",
    "LIMIT",
    "NEED_LOG",
    "NEED_OUTBOX",
    "NEED_PLACES",
    "NAN_ALLOWED",
    "NOT_A_NUMBER",
    "NOT_BASE64",
    "NOT_BEGUN",
    "NOT_CALLED",
    "NOT_READ",
    "NO_EVENT",
    "ORDER",
    "PER_NS",
    "PHASE",
    "PLACES",
    "PORTS",
    "Plan",
    "QUIT",
    "REALS_IN",
    "REALS_OUT",
    "ROLES",
    "ROWS",
    "RUNNING",
    "SEND",
    "SET_STRING",
    "SHOW",
    "SIGN",
    "SLOPE",
    "START",
    "STEP",
    "STEPS_DUE",
    "TICKET",
    "TOO_LONG",
    "UNTIL",
    "WHOLE",
    "WINDOW",
    "WIRE",
]

DONE, FAILED, NEED_PLACES, NEED_LOG, BLOCK_FULL, EVENTS_DUE, STEPS_DUE, NEED_OUTBOX = 0, 1, 2, 3, 4, 5, 6, 7
"""Reasons for which `run` returns."""

DELIVER, STEP, SEND = 0, 1, 2
"""Phases of a macro step, in `Plan.counters[PHASE]`."""

SET_STRING, DO_STEP, GET_REAL, GET_STRING = 4, 5, 6, 9
"""Numbers in `fmi.calls.FUNCTIONS`."""
NOT_A_NUMBER, TOO_LONG, NOT_BASE64, NOT_CALLED = -1, -2, -3, -4
"""Replace a status: an output is NaN (failed[2] is its index); packets that cannot be read; not stepped because another
instance of its FMU answered fmi2Fatal.
"""
ANSWERS = 32
"""Bytes of the answers of an FMI 3 instance: event handling needed, terminate simulation, early return (a byte each),
at 8 the last successful time, s. For the loop: at 16 the time of its next event, s; at 24 whether it uses Event Mode;
at 25 whether `super_dense` must still begin its step (BEGIN) or end it (END), or has outputs to be shown at its end
(SHOW); at 26 whether it must begin every step, because it sets inputs in Event Mode.
"""
BEGIN, END, SHOW = 1, 2, 3
NO_EVENT = 0xFFFF00
"""Bits of the first four bytes of ANSWERS that indicate more than an event in the step."""
LEFT = -8
"""Replaces a status: the step is left to Event Mode."""
NOT_BEGUN, NOT_READ = -1, -2
"""What a step in one call answers instead of a status: nothing has been done, or the outputs have not been read; the
calls of FMI, which the loop then makes, tell why.
"""
ENDED, EARLY = -6, -7
"""Replace a status: an FMI 3 FMU requests the end of the simulation; it has not simulated the whole step."""
FATAL = 4


INSTANCE = np.dtype(
    [
        ("handle", "u8"),
        ("do_step", "u8"),
        ("expect", "u8"),  # of our FMUs in large swarms: a function that prefetches its memory, 0: none
        ("whole", "u8"),  # of our FMUs: address of a WHOLE row, if one call sets its inputs, steps and gets; 0: none
        ("answers", "u8"),  # of FMI 3: address of what fmi3DoStep answers, see ANSWERS; 0 is FMI 2
        ("h", "f8"),  # its present step in s
        ("period", "i8"),  # base steps per step of the instance
        ("length", "i8"),  # base steps of its present step: the period, less at the end of the run
        ("library", "i4"),  # instances with the same number are of the same FMU
        ("endpoint", "i4"),  # -1 without packet ports
        ("failed", "i4", (3,)),  # function (0: not failed), status, detail
        ("first_set", "u4"),  # calls: fmi2SetString of its packets, if it has such a port,
        ("first_set_value", "u4"),  # fmi2SetXXX of its values,
        ("last_set", "u4"),  # fmi2GetXXX of the values that never change,
        ("first_get", "u4"),  # fmi2GetXXX of the others, fmi2GetString of its packets
        ("last_get", "u4"),
    ],
    align=True,
)
"""This record is small, since memory traffic costs more than computation with thousands of instances."""
WHOLE = np.dtype(
    [
        ("function", "u8"),  # uav_cosim_make_step, which takes the address of the next field
        ("handle", "u8"),
        ("moves", "u8"),  # address of what uav_cosim_note_step has noted
        ("values", "u8", (8,)),  # addresses of the inputs and outputs of each kind, and in PORTS: of `given` and `got`
    ]
)
"""The arguments of a step in one call (see fmi2.c); in `Plan.native`."""
FEED = np.dtype(
    [
        ("instance", "u4"),
        ("plain", "u4"),  # whether its real inputs are copied unchanged: factor 1 and offset 0 throughout
        ("first_in", "u4", (3,)),  # by kind
        ("last_in", "u4", (3,)),
        ("first_out", "u4", (3,)),
        ("last_out", "u4", (3,)),
    ]
)
"""The inputs and outputs of an instance; in `Plan.input_runs`, of adjacent instances with one period."""
WIRE = np.dtype([("factor", "f8"), ("offset", "f8")])
"""input = factor * output[source] + offset"""
DELAY = np.dtype(
    [
        ("whole", "i8"),  # 1: an integer or boolean
        ("source", "i8"),  # in real_out or int_out; -1: in another part of the run
        ("place", "i8"),  # there, too: the value for the input
        ("factor", "f8"),
        ("offset", "f8"),
        ("first", "i8"),  # in delay_line: the delayed values, one for each base step of the system's own grid
        ("length", "i8"),  # -1: no delay, a further term of the sum that is in `place`
    ]
)
"""A delayed connection, or a term of a sum."""
AHEAD = np.dtype([("instance", "i8"), ("begin", "u8"), ("post", "u8")])
"""An isolated instance whose step can be begun before its call of doStep: addresses of functions; 0: not any more."""
SLOPE = np.dtype(
    [
        ("input", "i8"),  # in real_in
        ("instance", "i8"),
        ("before", "f8"),  # its value in the step before,
        ("at", "i8"),  # which began then, ns,
        ("known", "i8"),  # if there was one
    ]
)
"""An extrapolated input; its derivative is in the same row of `Plan.derivatives`."""
PORTS = np.dtype(
    [
        ("instance", "i8"),
        ("has_rx", "i8"),
        ("has_tx", "i8"),
        ("given", "u8"),  # address of its row of `rx`, what it receives,
        ("given_size", "u8"),  # and its bytes, unless it is text
        ("got", "u8"),  # address of what it sends,
        ("got_size", "u8"),  # and its bytes, unless it is text
        ("filled", "i8"),  # 2: packets to set, 1: to be set to "" once, 0: nothing to do
        ("sent", "i8"),  # bytes in `tx`
        ("rx", "u4"),  # value references
        ("tx", "u4"),
        ("binary", "i8"),  # of FMI 3: bytes instead of base64 text
        ("raw", "i8"),  # of FMI 2 with steps in one call: bytes in these, base64 text in the calls of FMI
        ("get", "u4"),  # call that gets the packets; that of an instance's first endpoint is among its others
        ("further", "u4"),  # further endpoints of the same instance
    ],
    align=True,
)
"""The packet ports of one endpoint. The endpoints of an instance are consecutive."""
GROUP = np.dtype(
    [
        ("first_instance", "i8"),
        ("last_instance", "i8"),
        ("first_member", "i8"),  # in `Plan.members`
        ("last_member", "i8"),
        ("first_run", "i8"),  # in `Plan.input_runs`
        ("last_run", "i8"),
        ("first_real", "i8"),  # real outputs
        ("last_real", "i8"),
        ("first_recorded", "i8", (3,)),  # in `Plan.real_recorded`, of integers and of booleans in `Plan.int_recorded`
        ("last_recorded", "i8", (3,)),
        ("first_port", "i8"),
        ("last_port", "i8"),
        ("first_node", "i8"),
        ("last_node", "i8"),
        ("first_sent", "u8"),  # addresses of the first and the last SENT that is not yet routed; 0: none
        ("last_sent", "u8"),
        ("failed", "i8"),  # base step in which `failures` instances have failed, -1
        ("failures", "i8"),
    ]
)
"""Instances that make several base steps on their own, as nothing from other groups arrives before: see `windows`."""
INBOX = np.dtype(
    [
        ("heard", "i8"),  # ENDPOINT.heard, while its group is ahead of the others
        ("next", "i8"),  # the next place in flight to it that its group has not received yet, -1
        ("first", "u8"),  # addresses of the first and the last packet on board that are on the way to it, 0: none
        ("last", "u8"),
    ]
)
"""The packets that an endpoint receives while its group is ahead of the others."""

K, PHASE, ROWS, FAILURES, START, BASE, LAST, EVERY, REALS_IN, REALS_OUT, BLOCK, EVENTFUL, ORDER, FINER, FINAL = range(
    15
)
PER_NS, NAN_ALLOWED, EXPECTING, WINDOW, FROM, UNTIL = 15, 16, 17, 18, 19, 20
"""Places in `Plan.counters`. START and BASE in ticks, of which PER_NS make a nanosecond; REALS_IN, REALS_OUT: number of
real inputs and outputs; BLOCK: number of instances that a thread takes at a time, 0 without threads. EVENTFUL: number
of instances that use Event Mode. ORDER: JACOBI, IN_ORDER or BY_PYTHON, which is `iteration`. FINER: number of parts
into which base steps are currently divided. FINAL: whether no FMU state from before a step is restored after it.
NAN_ALLOWED: whether outputs may be NaN. EXPECTING: whether instances have functions `expect`. With groups: WINDOW, the
most base steps that they make on their own; FROM and UNTIL, the present window of base steps, all of which they have
made.
"""
JACOBI, IN_ORDER, BY_PYTHON = 0, 1, 2

TICKET, LIMIT, COMPLETED, QUIT, FAULTS, RUNNING, PLACES = 0, 8, 16, 24, 32, 40, 48
"""Places in `Plan.shared`, a cache line apart: the next block or group, the end of this step's, those completed, a flag
that ends the workers, failures, the FMI function being called, and the radio. Blocks are numbered consecutively from
the first step on, so that a late thread can never take a block of an earlier step, and no thread waits for an idle one.
RUNNING: the function that the main thread's loop has called last, for the report of a crash or a hang: the address of a
row of `Plan.calls`, or of `Plan.instances` for a step; 0 is none. The free instances, which are FMUs of this project,
do not note theirs.
PLACES: the address of `Radio.places`; a thread with another radio must get the present one before it steps a group.
"""

COPY, SIGN = 2**40, 2**41
"""Keys in `Plan.value_maps` outside the range of 32-bit integers. COPY: the first row of a mapping, which copies the
value unchanged. A row with another key replaces the value if it equals the key (mapping transformations of SSP). SIGN:
the upper half that extends a 32-bit value to 64 bits. A source of -1 - i is a 64-bit integer at i and i + 1.
"""


class Plan(NamedTuple):
    """All data of the loop except the radio's, in a few arrays, since numba's compile time grows with their number.

    The inputs and the outputs of all instances are numbered consecutively: reals first, then integers (with
    enumerations), then booleans. Values of reals are in `real_in` and `real_out`, the others in `int_in` and `int_out`.
    Integers that may need 64 bits have two places, the lower half first.

    Tables, whose comments name the type of their rows, are Any: mypy does not know fields, and takes seconds for them.
    """

    instances: Any  # INSTANCE
    calls: Any  # CALL, instance by instance
    feeds: Any  # FEED, of each instance
    input_runs: Any  # FEED, of as many instances as can be fed at a time
    sources: NDArray[np.uint32]  # of each input, within real_out or int_out
    wires: Any  # WIRE, of each real input
    real_in: NDArray[np.float64]
    int_in: NDArray[np.int32]
    real_out: NDArray[np.float64]
    int_out: NDArray[np.int32]
    int_to_real: NDArray[
        np.int64
    ]  # rows (int_out, real_out): integer outputs that real inputs take; -1 - i: a UInt32 at i
    value_maps: NDArray[np.int64]  # rows (int_out, int_out, key, value): see COPY
    ports: Any  # PORTS, of each endpoint
    rx: NDArray[np.uint8]  # (endpoints, longest text): packets for an instance: base64 text, or bytes (PORTS)
    received: NDArray[np.uint8]  # (threads, largest capacity): packets being delivered, before they are text
    tx: NDArray[np.uint8]  # (endpoints, largest capacity): packets from an instance
    encoded: NDArray[np.uint8]  # (threads, longest text): packets being collected, while they are text
    real_recorded: NDArray[np.int64]
    int_recorded: NDArray[np.int64]
    real_block: NDArray[np.float64]  # (rows, recorded reals)
    int_block: NDArray[np.int32]
    ticks: NDArray[np.int64]  # time of each row of the block, in ticks
    counters: NDArray[np.int64]
    grids: NDArray[np.int64]  # the periods, if no instance steps by the base step; else none
    delays: Any  # DELAY
    slopes: Any  # SLOPE, instance by instance
    derivatives: NDArray[np.float64]  # of the inputs in `slopes`
    delay_line: NDArray[np.float64]  # values in delayed connections
    step_sizes: NDArray[np.float64]  # the values that determine the next step size, where it is chosen
    confined: NDArray[np.int64]  # instances that only the main thread steps, in the order in which it does
    free: NDArray[np.int64]  # instances that any thread may step
    ahead: Any  # AHEAD, in the order of `confined`
    groups: Any  # GROUP; none: all instances make each base step together
    members: NDArray[np.int64]  # the instances of each group, in the order in which they step
    inboxes: Any  # INBOX, of each endpoint if there are groups
    positions: NDArray[np.int64]  # (nodes, 3): of each node in real_out, -1 without one, if there are groups
    past: NDArray[np.float64]  # (window, 3 * nodes): positions at the end of each base step of a window, m
    shared: NDArray[np.int64]
    native: NDArray[np.uint8]  # value references, buffers and answers of FMI 3, to which `calls` and `instances` point


ROLES = declared(
    CONSTANT="""
        instances.handle instances.do_step instances.expect instances.whole instances.answers instances.library
        instances.endpoint instances.first_set instances.first_set_value instances.last_set instances.first_get
        instances.last_get
        calls feeds input_runs sources wires int_to_real value_maps
        real_recorded int_recorded grids delays slopes.input slopes.instance confined free ahead members
        positions
        ports.instance ports.has_rx ports.has_tx ports.given ports.rx ports.tx ports.binary ports.raw ports.get
        ports.further
    """,
    STATE="""
        instances.h instances.length real_in int_in real_out int_out rx tx derivatives
        delay_line step_sizes slopes.before slopes.at slopes.known ports.filled ports.sent ports.given_size
    """,
    # Of `counters`, checkpoints store K and PHASE as words; of `native`, they store the answers of FMI 3 instances, by
    # instance.
    PASSING="instances.period instances.failed ports.got ports.got_size counters native",
    BUFFER="received encoded real_block int_block ticks shared groups inboxes past",
)
"""The role of each array of `Plan`, and of each column of its tables if their roles differ."""
