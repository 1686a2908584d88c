"""The features of the standards that are not supported, each with its message to the user, in one table.

Code that refuses or ignores a feature takes its message from here, so that the table agrees with the behaviour:

    python -m cosim_master.diagnostics.limitations > docs/limitations.md

To add or remove a row, change three places together: its constant here, the code that uses its message, and the case in
tests/master/diagnostics/test_limitations.py that provokes it. The tests there find a missing part.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

__all__ = ["LIMITATIONS", "Limitation", "table"]


@dataclass(frozen=True, slots=True)
class Limitation:
    """A feature that is not supported.

    Attributes:
        standard: the standard and, after a comma, the section. The standard is also the heading in the table.
        feature: name of the feature. Limitations with the same name share a row in the table.
        outcome: "error" (nothing is run), "failure" (the run ends there as failed), "note" (reported),
            "silent" (ignored).
        words: the message, with {} for names and values; empty for "silent".
    """

    standard: str
    feature: str
    outcome: str
    words: str

    @property
    def heading(self) -> str:
        """The standard, without the section."""
        return self.standard.partition(",")[0]

    @property
    def section(self) -> str:
        """The section of the standard; empty if none is given."""
        return self.standard.partition(", ")[2]

    def text(self, *values: object) -> str:
        """Returns the message with the given values."""
        return self.words.format(*values)


# ---- features with several messages, a row each ----------------------------------------------------------------------

_SOURCES = "absolute URIs (http:, file:) and systems of another .ssd (other.ssd#id) as sources"
_OPEN_ARRAYS = (
    "array connectors of a system whose size neither a number, a connection nor a structural parameter or"
    " constant of an FMU determines"
)
_CONNECTIONS = (
    "connections between two connectors of kind unspecified, and to a narrower type (Real to Integer, "
    "Integer to Int8, numbers to Boolean)"
)
_ENTRIES = "archives with encrypted entries, links, or compression methods other than deflate"
_CHANGED_FILES = (
    "changes (swap, save) of files that are not in UTF-8, and inside components that are files of their own"
)
_FOREIGN = "meta data, signatures (they are not verified) and annotations of other tools"
_OMS = (
    "OMSimulator's masters with variable steps (docs/masters.md describes richardson), tolerances of its "
    "other masters, result files"
)
_VERSIONS = "drafts of FMI 3.0, later versions, and Model Exchange of FMI 1.0"
_SCHEDULED = "Scheduled Execution"
_BINARIES = "FMUs without a binary for this platform, if there are no sources or these link a library of the FMU's own"
_ONE_PROCESS = (
    "in one process (see --isolate): several instances of an FMU with "
    "canBeInstantiatedOnlyOncePerProcess, and Python FMUs with different modules of the same name"
)
_CLOCKED_STEPS = (
    "connections of Clocks between instances with different step sizes; ticks and announced events during a step that "
    "must not be shortened"
)
_CHANGES = "changes (--at) of clocked variables, of structural parameters (reconfiguration), and during a step"
_WIDE = "enumerations with values that need more than 32 bits, if they are outputs, connected or set"
_PACKET_PORTS = (
    "packet ports beyond one input and one output per instance, and ports too small for a packet, without"
    " maxSize, or of a Clock"
)
_UNSOLVED = (
    "loops at initialization that neither iteration nor Newton's method solves; events that need more "
    "than 100 iterations"
)
_STEPS_LOST = (
    "discarded steps, if an FMU cannot go back or discards a thousandth as well; steps in the background (fmi2Pending)"
)
_DEEP_SYSTEMS = (
    "systems nested more than 60 deep or of more than 400000 parts; arrays of more than 65536 elements in"
    " SSP, 1048576 in FMI"
)
_LARGE_FILES = (
    "archives of more than 50000 entries or 2 GiB, XML files of more than 256 MiB, model descriptions of "
    "more than 128 MiB, multi-models of more than 64 MB"
)
_MAESTRO_MASTER = "var-step together with stabilisation; algorithms other than fixed-step and var-step"
_MAESTRO = "transfer and replacement of models during a run, fault injection"
_ECCO = "the algorithm ecco, whose steps vary, and its power bonds"
_UNWRITTEN_LINKS = (
    "connections that the engine's file or the engine does not have: sums, mapped values, recoded "
    "packets; to parameters (libcosim); with factor or offset (FMPy); of different types (libcosim, Ecos,"
    " OMSimulator); of Enumerations (libcosim, Ecos; FMPy without an item of value 0) and texts (FMPy, OMSimulator)"
)
_UNWRITTEN_PARTS = (
    "components that the engine does not run: FMI 3.0 (libcosim, FMPy), tables (all but linear CSV files "
    "for OMSimulator)"
)
_TIMES = (
    "step sizes whose common unit is too small for the run (1/30 s is possible); start and stop times "
    "between two nanoseconds"
)
_ENDS = "runs that end, and recordings with rows, between two communication points"
_LOOPS = "iterated loops with FMUs that cannot save their state or have Event Mode"
_VARIABLE = (
    "variable steps with FMUs whose steps have one size; with FMUs that cannot go back: error-controlled "
    "steps, Event Mode, repetition of steps that violate a constraint"
)
_FIXED_GRID = (
    "variable steps with delayed connections; error-controlled steps with a base step that is not a whole"
    " number of ns; error-controlled steps and delays with a base step far below all steps"
)

# ---- SSP -------------------------------------------------------------------------------------------------------------

MODELICA = Limitation(
    "SSP 2.0, 5.4", "Modelica components (text/x-modelica)", "error", 'type "{}" (Modelica) is not supported'
)
IMPLEMENTATION = Limitation(
    "FMI",
    _SCHEDULED,
    "error",
    'implementation="{}" is not supported; valid: any, CoSimulation, ModelExchange',
)
ABSOLUTE_URI = Limitation(
    "SSP 2.0, 5.4",
    _SOURCES,
    "error",
    "is an absolute URI; only paths relative to the .ssd are supported",
)
OTHER_SSD = Limitation("SSP 2.0, 5.4", _SOURCES, "error", "a system of another .ssd cannot be selected")
CLOCK = Limitation("SSP 2.0, 6", "clocks in signal dictionaries", "error", 'clocks of entry "{}" are not supported')
OPEN_SIZE = Limitation(
    "SSP 2.0, 4.5.3",
    _OPEN_ARRAYS,
    "error",
    'the size of array connector "{}" is open, and nothing that it is connected to has one',
)
SIZE_CONNECTOR = Limitation(
    "SSP 2.0, 4.5.3",
    _OPEN_ARRAYS,
    "error",
    'the size of array connector "{}" is that of "{}", which is not a structural parameter or constant of an FMU',
)
DIRECTION = Limitation(
    "SSP 2.0, 5.3.2.1",
    _CONNECTIONS,
    "error",
    "the direction between {} and {} is ambiguous",
)
NARROWING = Limitation(
    "SSP 2.0, 5.3.2.1",
    _CONNECTIONS,
    "error",
    "{} is {} and {} is {}; types must be equal (or Boolean to Integer to Real)",
)
MAPPED_BACK = Limitation(
    "SSP 2.0, 5.2.3",
    "start values of a system's output that is connected by a mapping transformation",
    "error",
    '"{}" cannot be set: a mapping transformation leads to {}',
)
DEEP = Limitation("Sizes", _DEEP_SYSTEMS, "error", "systems are nested more than {} deep")
LARGE = Limitation("Sizes", _DEEP_SYSTEMS, "error", "the system has {} parts; at most {} are possible")
LONG_ARRAY = Limitation(
    "Sizes",
    _DEEP_SYSTEMS,
    "error",
    "an array of {} elements is more than can be handled ({})",
)
ARCHIVE = Limitation("Sizes", _LARGE_FILES, "error", "unpacks to more than {} bytes")
ENTRIES = Limitation("Sizes", _LARGE_FILES, "error", "more than {} entries")
ENCRYPTED = Limitation("SSP 2.0, 3", _ENTRIES, "error", 'entry "{}" is encrypted')
COMPRESSION = Limitation(
    "SSP 2.0, 3",
    _ENTRIES,
    "error",
    'entry "{}" uses compression method {}; only stored and deflated are allowed',
)
LINK = Limitation("SSP 2.0, 3", _ENTRIES, "error", 'entry "{}" is a link or a special file')
LARGE_DOCUMENT = Limitation("Sizes", _LARGE_FILES, "error", "is larger than {} bytes")
ENCODING = Limitation(
    "SSP 2.0, 3",
    _CHANGED_FILES,
    "error",
    "is not encoded in UTF-8; save it as UTF-8 to change it",
)
INNER_FILE = Limitation(
    "SSP 2.0, 5.4",
    _CHANGED_FILES,
    "error",
    '"{}" is defined in a file of its own: change it there',
)
META_DATA = Limitation("SSP 2.0, 4.5.4", _FOREIGN, "note", "<{}> is ignored")
ANNOTATION = Limitation("SSP 2.0, 4.2", _FOREIGN, "note", 'annotation "{}" is ignored')
OMS_MASTER = Limitation(
    "SSP 2.0, 4.2",
    _OMS,
    "note",
    "OMSimulator's master with variable steps is not taken over ({}): steps have one size",
)
OMS_IGNORED = Limitation(
    "SSP 2.0, 4.2",
    _OMS,
    "note",
    "settings of OMSimulator that are ignored: {}",
)
NO_SOURCE = Limitation(
    "SSP 2.0, 5.4",
    "components without a source, which have no outputs",
    "note",
    'component "{}" has no source: it is taken for an empty system',
)
SIGNAL_START = Limitation(
    "SSP 2.0, 5.5",
    "start values of connectors of a signal dictionary reference",
    "note",
    '"{}" sets nothing: a signal has no start value',
)
LOCAL = Limitation(
    "SSP 2.0, 5.2.1",
    "connections from local variables of FMI 2, which must not be read during initialization",
    "note",
    "{}.{} is local: it is exchanged from the first step on only",
)
GEOMETRY = Limitation("SSP 2.0, 5.2.2", "geometry, notes and icons", "silent", "")

# ---- FMI, whatever version -------------------------------------------------------------------------------------------

FMI_VERSION = Limitation(
    "FMI",
    _VERSIONS,
    "error",
    'FMI "{}" is not supported; valid: fmiVersion="1.0", "2.0" and "3.0"',
)
EXCHANGE1 = Limitation(
    "FMI",
    _VERSIONS,
    "error",
    "is an FMU of FMI 1.0 for Model Exchange; of FMI 1.0 only co-simulation is supported",
)
SCHEDULED_EXECUTION = Limitation(
    "FMI",
    _SCHEDULED,
    "error",
    "is an FMU for Scheduled Execution only, which is not supported; valid: CoSimulation, ModelExchange",
)
EXCHANGE_CLOCKS = Limitation(
    "FMI 3.0.2, 3",
    "Clocks of FMUs for Model Exchange",
    "error",
    'has Clocks ("{}") in Model Exchange, which are not supported',
)
NO_LIBRARY = Limitation(
    "FMI",
    _BINARIES,
    "error",
    "has no library for this platform ({}); {}",
)
SOURCE_LIBRARY = Limitation(
    "FMI",
    _BINARIES,
    "error",
    '<Library> "{}" is not external: sources that need a library of the FMU\'s own are not supported',
)
LARGE_DESCRIPTION = Limitation("Sizes", _LARGE_FILES, "error", 'entry "{}" is larger than {} bytes')
ONLY_ONCE = Limitation(
    "FMI",
    _ONE_PROCESS,
    "error",
    "{} can be instantiated only once per process, but is used by {} and {}, and is not isolated (--isolate)",
)
PYTHON_SOURCES = Limitation(
    "FMI",
    _ONE_PROCESS,
    "error",
    "was built from another {} than {}; both would share one; {}",
)
DISCARDED = Limitation(
    "FMI",
    _STEPS_LOST,
    "failure",
    "fmi{}Discard: it could not step from {} s to {} s{}; {}",
)
TOLERANCE = Limitation(
    "FMI", "tolerances, derivatives of outputs and directional derivatives in co-simulation", "silent", ""
)

# ---- FMI 2.0 ---------------------------------------------------------------------------------------------------------

PENDING = Limitation(
    "FMI",
    _STEPS_LOST,
    "failure",
    "fmi2Pending: it goes on in the background, which is not supported",
)

# ---- FMI 3.0 ---------------------------------------------------------------------------------------------------------

TIED_STEPS = Limitation(
    "FMI 3.0.2, 2.4.7",
    _CLOCKED_STEPS,
    "error",
    "instances that are connected by Clocks must have one step size, but step {}",
)
MISSED_TICK = Limitation(
    "FMI 3.0.2, 2.4.7",
    _CLOCKED_STEPS,
    "failure",
    "an event or a tick of a Clock is at {} s, in the middle of a step, and it cannot take a shorter one",
)
CLOCKED_CHANGE = Limitation(
    "Runs",
    _CHANGES,
    "error",
    "it belongs to the Clock {}: it can be set only while that ticks",
)
STRUCTURAL_CHANGE = Limitation(
    "Runs",
    _CHANGES,
    "error",
    "it is a structural parameter, which sizes arrays: it can be set before the run only",
)
CLOCKED_PACKETS = Limitation(
    "MAVLink",
    _PACKET_PORTS,
    "note",
    '"{}" carries MAVLink packets but belongs to a Clock: it is not connected to the radio',
)
LARGE_VARIABLE = Limitation(
    "Sizes",
    _DEEP_SYSTEMS,
    "error",
    'variable "{}" has {} elements; at most {} are possible',
)
WIDE_INTEGER = Limitation(
    "FMI 3.0.2, 2.4.7",
    _WIDE,
    "failure",
    "an integer does not fit: the master carries 32 bits of an enumeration, and the variable may have fewer",
)
WIDE_ITEM = Limitation(
    "FMI 3.0.2, 2.4.7",
    _WIDE,
    "error",
    '{}.{} is an Enumeration whose item "{}" is {}; the master carries 32 bits of an enumeration',
)
UNSETTLED = Limitation(
    "Runs",
    _UNSOLVED,
    "failure",
    "{} do not settle in {} iterations at one time",
)
NO_MAX_SIZE = Limitation(
    "MAVLink",
    _PACKET_PORTS,
    "note",
    '"{}" carries MAVLink packets but has no maxSize: it is not connected to the radio',
)
INTERMEDIATE_UPDATE = Limitation(
    "FMI 3.0.2, 4.2",
    "intermediate update: new values of inputs in the middle of a step",
    "note",
    "its inputs {} could get new values in the middle of a step (intermediateUpdate); they keep theirs over each step",
)

# ---- MAVLink ---------------------------------------------------------------------------------------------------------

SEVERAL_PORTS = Limitation(
    "MAVLink",
    _PACKET_PORTS,
    "error",
    "{} has several packet {}s for the radio, {}: one is valid",
)
SMALL_PORT = Limitation(
    "MAVLink",
    _PACKET_PORTS,
    "error",
    "{} holds {} bytes, and a MAVLink packet may have {}",
)
DIALECT = Limitation(
    "MAVLink", "dialects that give ids or names of ardupilotmega to other messages", "error", 'dialect="{}": {}'
)
ADDRESS = Limitation(
    "MAVLink",
    "gateways other than TCP servers and UDP sockets (such as serial ports and TCP clients)",
    "error",
    "{} is not an address: write KIND:[HOST:]PORT, its kind one of {}",
)
SIGNATURE = Limitation(
    "MAVLink", "signatures of packets between instances, which are neither created nor checked", "silent", ""
)

# ---- multi-models of INTO-CPS ----------------------------------------------------------------------------------------

ALGORITHM = Limitation(
    "Multi-models", _MAESTRO_MASTER, "error", 'algorithm: its type is {}; valid: "fixed-step", "var-step"'
)
VAR_STEP = Limitation(
    "Multi-models",
    _MAESTRO_MASTER,
    "error",
    'stabilisation: loops are not iterated where constraints decide the steps; leave it out, or take "fixed-step"',
)
STABILISATION = Limitation(
    "Multi-models",
    "stabilisation that stops after a number of tries without convergence",
    "note",
    "{}: with stabilisation every loop is iterated to {}; Maestro stops after {} tries, settled or not",
)
TRANSFER = Limitation("Multi-models", _MAESTRO, "error", "{}: model transfer is not supported")
SWAP = Limitation("Multi-models", _MAESTRO, "error", "{}: model swap is not supported")
FAULTS = Limitation("Multi-models", _MAESTRO, "error", "{}: fault injection is not supported")
LARGE_FILE = Limitation("Sizes", _LARGE_FILES, "error", "is larger than {} MB")

# ---- OspSystemStructure.xml ------------------------------------------------------------------------------------------

OSP_ALGORITHM = Limitation(
    "OspSystemStructure",
    _ECCO,
    "error",
    '<Algorithm> is "{}"; valid: fixedStep',
)
OSP_BOND = Limitation(
    "OspSystemStructure",
    _ECCO,
    "note",
    'powerBond="{}" is ignored: only ecco uses it, and steps have one size',
)

# ---- projects of MasterSim -------------------------------------------------------------------------------------------

MASTERSIM_STEPS = Limitation(
    "MasterSim",
    "step sizes adjusted by the number of iterations (adjustStepSize without STEP_DOUBLING)",
    "error",
    "adjustStepSize: steps adjusted by the number of iterations are not supported; take ErrorControlMode STEP_DOUBLING",
)
MASTERSIM_ITERATION = Limitation(
    "MasterSim",
    "NEWTON that iterates each cycle alone and stops after maxIterations without convergence",
    "note",
    "loops are iterated to {}, over all cycles; MasterSim iterates each cycle alone and stops after {} tries",
)
MASTERSIM_IGNORED = Limitation(
    "MasterSim", "tolerances for FMUs, and settings of result files", "note", "settings that are not taken over: {}"
)
# ---- writing for other engines ---------------------------------------------------------------------------------------

CONVERTED_LINK = Limitation(
    "Conversion",
    _UNWRITTEN_LINKS,
    "error",
    "{} is {}: the file that is written cannot say this",
)
FMPY_TRANSFORMATION = Limitation(
    "Conversion",
    _UNWRITTEN_LINKS,
    "error",
    "{}: FMPy applies no factor, offset or unit",
)
ENGINE_TYPES = Limitation(
    "Conversion",
    _UNWRITTEN_LINKS,
    "error",
    "{} is {} and driven by {}, which {} does not connect",
)
ENGINE_FMI = Limitation(
    "Conversion",
    _UNWRITTEN_PARTS,
    "error",
    "{} is of FMI {}, which {} does not run in a system",
)

ENGINE_TABLE = Limitation(
    "Conversion",
    _UNWRITTEN_PARTS,
    "error",
    "{} is a file of values ({}), which {} does not read so",
)
ENGINE_VALUE = Limitation(
    "Conversion",
    "start values of Enumerations (libcosim, Ecos); texts and false, if the FMU's own value is another (FMPy)",
    "error",
    "{} is {}, which {} does not set",
)
FMPY_ZERO = Limitation(
    "Conversion",
    _UNWRITTEN_LINKS,
    "error",
    "{} is an Enumeration without an item of value 0, which FMPy sets first",
)

# ---- masters ---------------------------------------------------------------------------------------------------------

FINE_STEPS = Limitation(
    "Runs",
    _TIMES,
    "error",
    "step size {} s: to count the time of this run exactly takes more than 62 bits; try {}",
)
WHOLE_TIMES = Limitation(
    "Runs",
    _TIMES,
    "error",
    "start and stop time must be whole nanoseconds",
)
BASE_STEP = Limitation(
    "Runs",
    _ENDS,
    "error",
    "a run of {} s is not a multiple of the base step {} s; try --until {}",
)
OVERRUN = Limitation(
    "Runs",
    _ENDS,
    "error",
    "{} steps by {} s only (canHandleVariableCommunicationStepSize is false): a run of {} s is not a multiple of it",
)
RECORDING_INTERVAL = Limitation(
    "Runs",
    _ENDS,
    "error",
    "recording interval {} s is not a multiple of the base step {} s; try --set recording.interval={}",
)
CHANGE = Limitation(
    "Runs",
    _CHANGES,
    "error",
    "no step of {} begins then; its steps begin every {} s from {} to {} s",
)
NOT_A_NUMBER = Limitation(
    "Runs",
    'outputs that are NaN, unless the run or the annotation org.uav-cosim.master says nan="allow"',
    "failure",
    '{} is not a number; where that is meant, allow it: --set master.nan=allow, or nan="allow" of <master>',
)
INITIAL_LOOP = Limitation(
    "Runs",
    _UNSOLVED,
    "failure",
    "these outputs depend on each other at initialization, and do not settle in {} rounds:",
)
CHECKPOINT = Limitation(
    "Runs",
    "checkpoints of systems with gateways, and with FMUs that cannot serialise their state",
    "error",
    "a run of this system has no checkpoints: {}",
)
EXTRAPOLATION = Limitation(
    "Runs",
    "extrapolated inputs other than Reals, of FMI 3, without canInterpolateInputs, or with iterating masters",
    "error",
    "{}.{} cannot be extrapolated: {}",
)
LOOP_STATE = Limitation(
    "Runs",
    _LOOPS,
    "error",
    "{}: {} is part of a loop, and canGetAndSetFMUstate of its FMU is false{}",
)
LOOP_EVENTS = Limitation(
    "Runs",
    _LOOPS,
    "error",
    "{}: {} is part of a loop, and its FMU has Event Mode, which cannot be iterated",
)
INPUTS_BY_STEP = Limitation(
    "Runs",
    "discrete inputs of FMUs with Event Mode that change in Step Mode, with other algorithms than jacobi",
    "note",
    "its discrete inputs {} change in Step Mode with algorithm {}: it may see new values at its next event only",
)
STEP_CONTROL = Limitation(
    "Runs",
    _VARIABLE,
    "error",
    "{}: {} of {} is false{}",
)
STEP_COUNTS = Limitation(
    "Runs",
    _VARIABLE,
    "note",
    "var-step: canGetAndSetFMUstate of {} is false{}: a step that violates a constraint counts, it is not repeated",
)
STEP_EVENTS = Limitation(
    "Runs",
    _VARIABLE,
    "error",
    "{}: {} has Event Mode, and an event within a step cannot be gone back to: canGetAndSetFMUstate of {} is false",
)
STEP_DELAY = Limitation(
    "Runs",
    _FIXED_GRID,
    "error",
    "{}: the connection to {} is delayed, which needs steps of one size",
)
STEP_FRACTION = Limitation(
    "Runs",
    _FIXED_GRID,
    "error",
    "richardson: its rows lie on whole nanoseconds, but the base step is {} s; try --step with one that is whole",
)
FINE_GRID = Limitation(
    "Runs",
    _FIXED_GRID,
    "error",
    "{} need each base step, {} s here, where the shortest step is {} s; try step sizes with a larger common divisor",
)

LIMITATIONS = tuple(value for value in tuple(globals().values()) if isinstance(value, Limitation))


_HAPPENS = {"error": "error", "failure": "the run fails", "note": "note", "silent": "ignored"}


def table() -> str:
    """Returns the tables of all limitations, one for each standard, in Markdown. Equal features share a row."""
    lines = [
        "# Limitations",
        "",
        "This page lists the features of the standards that `uav-cosim` does not support, with the messages that name",
        "them: a search for a message leads to its row. *Error*: nothing is run. The page is generated by",
        "`python -m cosim_master.diagnostics.limitations > docs/limitations.md` from the messages in the code; a test",
        "provokes every one of them.",
    ]
    for standard in dict.fromkeys(one.heading for one in LIMITATIONS):
        lines += ["", f"## {standard}", "", "| feature | behaviour | message |", "|---|---|---|"]
        rows: dict[str, list[Limitation]] = {}
        for one in LIMITATIONS:
            if one.heading == standard:
                rows.setdefault(one.feature, []).append(one)
        for feature, same in rows.items():
            sections = ", ".join(dict.fromkeys(one.section for one in same if one.section))
            happens = ", ".join(dict.fromkeys(_HAPPENS[one.outcome] for one in same))
            words = "<br>".join(f"`{one.words.replace('{}', '…')}`" for one in same if one.words)
            lines.append(f"| {feature}{f' ({sections})' if sections else ''} | {happens} | {words} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(table())
