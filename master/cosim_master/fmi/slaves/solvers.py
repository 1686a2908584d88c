"""Solvers of ordinary differential equations with state events, for FMUs for Model Exchange.

    solver = make(Choice("cvode"), equations)
    solver.reset(t, h)               begins a communication step of h s after a change of states, inputs or time
    solver.resume(h)                 begins a communication step of h s without any change
    solver.advance(stop)             one internal step, at most to `stop`; True if an event indicator changed its sign

CVODE is SUNDIALS' variable-step BDF method, from the libraries that FMPy contains. Euler and RK4 have fixed steps and
locate events by bisection. CVODE stores previous steps and therefore cannot go back. With `restart`, it starts anew at
every communication point, which is slower and, at the same tolerance, less accurate (see docs/one-fmu.md).
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

__all__ = ["NAMES", "Choice", "Equations", "Rejected", "Solver", "SolverError", "make"]

NAMES = ("cvode", "euler", "rk4")
_TOLERANCE = 1e-6
_BISECTIONS = 60
_MAX_STEPS = 100_000
_CV_BDF, _CV_ONE_STEP, _CV_ROOT_RETURN = 2, 2, 2
_FAILED = {
    -1: "it has taken too many steps",
    -2: "the tolerance is too small for this accuracy of numbers",
    -3: "error tests failed too often: is there a discontinuity without an event?",
    -4: "the corrector did not converge",
    -6: "the Jacobian is singular",
    -9: "the first derivatives could not be evaluated",
    -10: "the derivatives could not be evaluated again and again",
}


class SolverError(Exception):
    """The solver cannot continue; the message gives the reason."""


class Rejected(Exception):
    """The derivatives cannot be evaluated at these states; a shorter step may help."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The choice of a solver and of its accuracy.

    Attributes:
        name: one of NAMES.
        step: step of a fixed-step solver, s; None uses the FMU's, or the communication step.
        tolerance: relative tolerance of CVODE; None uses the FMU's, or 1e-6. The absolute tolerance is the relative one
            times the nominal value.
        restart: CVODE restarts at every communication point, so that a saved state of the FMU is complete.
    """

    name: str = "cvode"
    step: float | None = None
    tolerance: float | None = None
    restart: bool = False

    @property
    def can_go_back(self) -> bool:
        """True if the solver has no memory beyond states, inputs and time."""
        return self.restart or self.name != "cvode"

    @staticmethod
    def parsed(text: str) -> Choice:
        """Returns the choice written as NAME or NAME:NUMBER; the number is cvode's tolerance or the step of the others.

        Raises:
            ValueError: the text is invalid; the error names the valid choices.
        """
        name, colon, number = text.partition(":")
        if name not in NAMES:
            raise ValueError(f'there is no solver "{name}"; valid: {", ".join(NAMES)}')
        if not colon:
            return Choice(name)
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            what = "tolerance" if name == "cvode" else "step in s"
            raise ValueError(f'"{number}" is not a positive {what}')
        return Choice(name, tolerance=value) if name == "cvode" else Choice(name, step=value)


class Equations(Protocol):
    """The equations that are integrated; vectors are addresses of doubles."""

    states: int
    indicators: int
    has_jacobian: bool

    def derivatives(self, t: float, x: int, dx: int) -> None:
        """Writes the derivatives of the states `x` at a time; may raise Rejected."""

    def event_indicators(self, t: float, x: int, z: int) -> None:
        """Writes the event indicators."""

    def nominals(self, x: int) -> None:
        """Writes the nominal values of the states."""

    def read_states(self, x: int) -> None:
        """Writes the states."""

    def jacobian_column(self, t: float, x: int, number: int, column: int) -> None:
        """Writes the partial derivatives of all derivatives with respect to state `number`."""


class Solver(Protocol):
    """The interface of all solvers."""

    time: float
    x: Any

    def reset(self, time: float, h: float) -> None: ...

    def resume(self, h: float) -> None: ...

    def advance(self, stop: float) -> bool: ...

    def close(self) -> None: ...


def make(choice: Choice, equations: Equations, *, step: float | None = None, tolerance: float | None = None) -> Solver:
    """Returns a solver.

    Args:
        choice: the solver and its accuracy.
        equations: the equations to be solved.
        step, tolerance: those of the FMU, if the choice does not specify them.

    Raises:
        SolverError: the solver is not available on this machine.
    """
    if choice.name == "cvode" and equations.states:
        return _Cvode(equations, choice.tolerance or tolerance or _TOLERANCE)
    stages = _RK4 if choice.name == "rk4" else _EULER
    return _FixedStep(equations, stages, choice.step or step)


_EULER = (((0.0,),), (1.0,))
_RK4 = (((0.0,), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6))
"""Explicit Runge-Kutta methods: rows of their tableau (the first is not used), and weights."""


class _FixedStep:
    def __init__(self, equations: Equations, tableau: Any, step: float | None) -> None:
        self._equations = equations
        self._rows, self._weights = tableau
        self._step = step
        n = equations.states
        self.time = 0.0
        self.x = np.zeros(n)
        self._stage, self._slopes = np.zeros(n), np.zeros((len(self._weights), n))
        self._signs = np.zeros(equations.indicators, dtype=bool)
        self._h = 0.0

    def reset(self, time: float, h: float) -> None:
        self.time = time
        self._h = h if self._step is None else min(self._step, h)
        self._equations.read_states(self.x.ctypes.data)
        self._signs = self._positive(time, self.x)

    def resume(self, h: float) -> None:
        self._h = h if self._step is None else min(self._step, h)

    def advance(self, stop: float) -> bool:
        parts = max(1, math.ceil((stop - self.time) / self._h - 1e-9))
        start, end = self.time, stop if parts == 1 else self.time + (stop - self.time) / parts
        before = self.x.copy()
        after = self._stepped(start, before, end - start)
        signs = self._positive(end, after)
        found = bool((signs != self._signs).any())
        if found:
            low, high = 0.0, 1.0
            for _ in range(_BISECTIONS):
                middle = 0.5 * (low + high)
                t = start + middle * (end - start)
                if not start < t < end or middle in (low, high):
                    break
                x = self._stepped(start, before, t - start)
                if (self._positive(t, x) != self._signs).any():
                    high, after = middle, x
                else:
                    low = middle
            end = end if high == 1.0 else start + high * (end - start)
            signs = self._positive(end, after)
        self.time, self._signs = end, signs
        self.x[:] = after
        return found

    def _stepped(self, t: float, x: Any, h: float) -> Any:
        """Returns the states after an explicit Runge-Kutta step of any size."""
        slopes = self._slopes
        for i, row in enumerate(self._rows):
            fraction = sum(row)
            self._stage[:] = x
            for j, factor in enumerate(row if i else ()):
                if factor:
                    self._stage += h * factor * slopes[j]
            self._equations.derivatives(t + fraction * h, self._stage.ctypes.data, slopes[i].ctypes.data)
        result = x.copy()
        for weight, slope in zip(self._weights, slopes, strict=True):
            result += h * weight * slope
        return result

    def _positive(self, t: float, x: Any) -> Any:
        z = np.zeros(self._equations.indicators)
        if z.size:
            self._equations.event_indicators(t, x.ctypes.data, z.ctypes.data)
        return z > 0.0

    def close(self) -> None:
        pass


class _Cvode:
    """SUNDIALS' CVODE: BDF, dense linear algebra, roots of the event indicators."""

    def __init__(self, equations: Equations, tolerance: float) -> None:
        try:
            from fmpy import sundials
            from fmpy.sundials import cvode, libraries
        except (ImportError, OSError) as error:
            raise SolverError(f"CVODE is not to be had here ({error}); choose euler or rk4") from None
        self._equations, self._tolerance = equations, tolerance
        self._s, self._c, self._libraries = sundials, cvode, libraries
        self._set_stop = self._function(libraries.sundials_cvode, "CVodeSetStopTime", ctypes.c_void_p, ctypes.c_double)
        self._error: BaseException | None = None
        n, z = equations.states, equations.indicators
        self._context = sundials.SUNContext()
        self._check(sundials.SUNContext_Create(0, ctypes.byref(self._context)), "SUNContext_Create")
        clear = self._function(libraries.sundials_core, "SUNContext_ClearErrHandlers", ctypes.c_void_p)
        clear(self._context)
        self._vector, self._tolerances = (sundials.N_VNew_Serial(n, self._context) for _ in range(2))
        self.time = 0.0
        self.x = np.ctypeslib.as_array(sundials.NV_DATA_S(self._vector), (n,))
        self._absolute = np.ctypeslib.as_array(sundials.NV_DATA_S(self._tolerances), (n,))
        # Callbacks of CVODE must live as long as it does.
        self._f, self._g = sundials.CVRhsFn(self._derivatives), sundials.CVRootFn(self._indicators)
        self._memory = ctypes.c_void_p(cvode.CVodeCreate(_CV_BDF, self._context))
        self._absolute[:] = tolerance
        self._check(cvode.CVodeInit(self._memory, self._f, 0.0, self._vector), "CVodeInit")
        self._check(cvode.CVodeSVtolerances(self._memory, tolerance, self._tolerances), "CVodeSVtolerances")
        if z:
            self._check(cvode.CVodeRootInit(self._memory, z, self._g), "CVodeRootInit")
            self._check(cvode.CVodeSetNoInactiveRootWarn(self._memory), "CVodeSetNoInactiveRootWarn")
        self._matrix = sundials.SUNDenseMatrix(n, n, self._context)
        self._linear = sundials.SUNLinSol_Dense(self._vector, self._matrix, self._context)
        self._check(sundials.CVodeSetLinearSolver(self._memory, self._linear, self._matrix), "CVodeSetLinearSolver")
        if equations.has_jacobian:
            self._use_jacobian()

    @staticmethod
    def _function(library: Any, name: str, *arguments: Any, result: Any = ctypes.c_int) -> Any:
        function = library[name]  # a separate library object, whose types are not shared
        function.argtypes, function.restype = arguments, result
        return function

    def _use_jacobian(self) -> None:
        double = ctypes.POINTER(ctypes.c_double)
        vector = self._s.N_Vector
        kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, vector, vector, *[ctypes.c_void_p] * 5)
        column = self._function(
            self._libraries.sundials_sunmatrixdense,
            "SUNDenseMatrix_Column",
            ctypes.c_void_p,
            ctypes.c_int64,
            result=double,
        )

        def jacobian(t: float, y: Any, _fy: Any, matrix: Any, *_: Any) -> int:
            def write() -> None:
                x = self._address(y)
                for j in range(self._equations.states):
                    place = ctypes.cast(column(matrix, j), ctypes.c_void_p).value
                    self._equations.jacobian_column(t, x, j, place or 0)

            return self._guarded(write)

        self._jacobian = kind(jacobian)
        use = self._function(self._libraries.sundials_cvode, "CVodeSetJacFn", ctypes.c_void_p, kind)
        self._check(use(self._memory, self._jacobian), "CVodeSetJacFn")

    def _address(self, vector: Any) -> int:
        return ctypes.cast(self._s.NV_DATA_S(vector), ctypes.c_void_p).value or 0

    def _guarded(self, call: Any) -> int:
        """Returns the answer to CVODE: 0 done, 1 try a shorter step, -1 give up; stores the error."""
        try:
            call()
        except Rejected:
            return 1
        except BaseException as error:
            self._error = error
            return -1
        return 0

    def _derivatives(self, t: float, y: Any, into: Any, _data: Any) -> int:
        return self._guarded(lambda: self._equations.derivatives(t, self._address(y), self._address(into)))

    def _indicators(self, t: float, y: Any, into: Any, _data: Any) -> int:
        place = ctypes.cast(into, ctypes.c_void_p).value or 0
        return self._guarded(lambda: self._equations.event_indicators(t, self._address(y), place))

    def _check(self, status: int, function: str) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        if status < 0:
            why = _FAILED.get(status, f"{function} returned {status}")
            raise SolverError(f"CVODE cannot go on at t = {self.time:.9g} s: {why}")

    def reset(self, time: float, h: float) -> None:  # noqa: ARG002 (its steps are its own)
        self.time, self._steps = time, 0
        self._equations.read_states(self.x.ctypes.data)
        self._equations.nominals(self._absolute.ctypes.data)
        self._absolute[:] = self._tolerance * np.where(self._absolute == 0.0, 1.0, np.abs(self._absolute))
        self._check(self._c.CVodeReInit(self._memory, time, self._vector), "CVodeReInit")
        self._check(self._c.CVodeSVtolerances(self._memory, self._tolerance, self._tolerances), "CVodeSVtolerances")

    def resume(self, h: float) -> None:  # noqa: ARG002
        self._steps = 0

    def advance(self, stop: float) -> bool:
        self._steps += 1
        if self._steps > _MAX_STEPS:
            where = f"{_MAX_STEPS} steps and is at t = {self.time:.9g} s"
            raise SolverError(f"CVODE has taken {where}: choose shorter communication steps")
        reached = ctypes.c_double(self.time)
        self._check(self._set_stop(self._memory, stop), "CVodeSetStopTime")
        status = self._c.CVode(self._memory, stop, self._vector, ctypes.byref(reached), _CV_ONE_STEP)
        if status < 0 or self._error is not None:
            self._check(status, "CVode")
        self.time = reached.value
        return bool(status == _CV_ROOT_RETURN)

    def close(self) -> None:
        self._c.CVodeFree(ctypes.byref(self._memory))
        core, dense = self._libraries.sundials_core, self._libraries.sundials_sunmatrixdense
        self._function(core, "SUNLinSolFree", ctypes.c_void_p)(self._linear)
        self._function(dense, "SUNMatDestroy_Dense", ctypes.c_void_p, result=None)(self._matrix)
        for vector in (self._vector, self._tolerances):
            self._s.N_VDestroy_Serial(vector)
        self.x = self._absolute = np.zeros(0)
        self._function(core, "SUNContext_Free", ctypes.c_void_p)(ctypes.byref(self._context))
