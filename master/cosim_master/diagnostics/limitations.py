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
        feature: name of the feature.
        outcome: "error" (nothing is run), "failure" (the run ends there as failed), "note" (ignored, and reported),
            "silent" (ignored).
        words: the message, with {} for names and values; empty for "silent".
    """

    standard: str
    feature: str
    outcome: str
    words: str

    def text(self, *values: object) -> str:
        """Returns the message with the given values."""
        return self.words.format(*values)


MODELICA = Limitation(
    "SSP 2.0, 5.4", "Modelica components (text/x-modelica)", "error", 'type "{}" (Modelica) is not supported'
)
IMPLEMENTATION = Limitation(
    "SSP 2.0, 5.4",
    "implementation of an FMU that is not one of its interfaces",
    "error",
    'implementation="{}" is not supported; valid: any, CoSimulation, ModelExchange',
)
ABSOLUTE_URI = Limitation(
    "SSP 2.0, 5.4",
    "absolute URIs (http:, file:) as sources; the standard does not require them",
    "error",
    "is an absolute URI; only paths relative to the .ssd are supported",
)
OTHER_SSD = Limitation(
    "SSP 2.0, 5.4", "a system of another .ssd (other.ssd#id)", "error", "a system of another .ssd cannot be selected"
)
CLOCK = Limitation("SSP 2.0, 6", "clocks in signal dictionaries", "error", 'clocks of entry "{}" are not supported')
OPEN_SIZE = Limitation(
    "SSP 2.0, 4.5.3",
    "array connectors of systems whose size is open and not determined by any connection",
    "error",
    'the size of array connector "{}" is open, and nothing that it is connected to has one',
)
SIZE_CONNECTOR = Limitation(
    "SSP 2.0, 4.5.3",
    "sizes given by a connector (sizeConnector) that is not a structural parameter or constant of an FMU",
    "error",
    'the size of array connector "{}" is that of "{}", which is not a structural parameter or constant of an FMU',
)
DIRECTION = Limitation(
    "SSP 2.0, 5.3.2.1",
    "connections of two connectors of kind unspecified",
    "error",
    "the direction between {} and {} is ambiguous",
)
NARROWING = Limitation(
    "SSP 2.0, 5.3.2.1",
    "connections from a type to a narrower one (Real to Integer, Integer to Int8, numbers to Boolean)",
    "error",
    "{} is {} and {} is {}; types must be equal (or Boolean to Integer to Real)",
)
MAPPED_BACK = Limitation(
    "SSP 2.0, 5.2.3",
    "start values of a system's output that is connected by a mapping transformation",
    "error",
    '"{}" cannot be set: a mapping transformation leads to {}',
)
DEEP = Limitation("SSP 2.0, 5.3", "systems nested more than 60 deep", "error", "systems are nested more than {} deep")
LARGE = Limitation(
    "SSP 2.0, 5.3", "systems of more than 200000 parts", "error", "the system has {} parts; at most {} are possible"
)
LONG_ARRAY = Limitation(
    "SSP 2.0, 4.5.3",
    "arrays of more than 65536 elements",
    "error",
    "an array of {} elements is more than can be handled ({})",
)
ARCHIVE = Limitation(
    "SSP 2.0, 3", "archives that unpack to more than 2 GiB together", "error", "unpacks to more than {} bytes"
)
ENTRIES = Limitation("SSP 2.0, 3", "archives of more than 50000 entries", "error", "more than {} entries")
ENCRYPTED = Limitation("SSP 2.0, 3", "encrypted entries of archives", "error", 'entry "{}" is encrypted')
COMPRESSION = Limitation(
    "SSP 2.0, 3",
    "archives with compression methods other than deflate",
    "error",
    'entry "{}" uses compression method {}; only stored and deflated are allowed',
)
LINK = Limitation("SSP 2.0, 3", "links in archives", "error", 'entry "{}" is a link or a special file')
LARGE_DOCUMENT = Limitation("SSP 2.0, 3", "XML files of more than 256 MiB", "error", "is larger than {} bytes")
ENCODING = Limitation(
    "SSP 2.0, 3",
    "changing (swap, save) files in encodings other than UTF-8; reading them is supported",
    "error",
    "is not encoded in UTF-8; save it as UTF-8 to change it",
)
INNER_FILE = Limitation(
    "SSP 2.0, 5.4",
    "saving changes inside a component that is a separate .ssd or .ssp",
    "error",
    '"{}" is defined in a file of its own: change it there',
)
META_DATA = Limitation("SSP 2.0, 4.5.4", "meta data and signatures (they are not verified)", "note", "<{}> is ignored")
ANNOTATION = Limitation("SSP 2.0, 4.2", "annotations of other tools", "note", 'annotation "{}" is ignored')
OMS_MASTER = Limitation(
    "SSP 2.0, 4.2",
    "OMSimulator's masters with variable steps (oms-mav); docs/masters.md describes an alternative (richardson)",
    "note",
    "OMSimulator's master with variable steps is not taken over ({}): steps have one size",
)
OMS_IGNORED = Limitation(
    "SSP 2.0, 4.2",
    "other settings of OMSimulator: tolerances of a master with fixed steps, result files",
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
UNIT_GAP = Limitation(
    "SSP 2.0, 4.5.1",
    "connections between a port with a unit and a port without",
    "note",
    "{} connections join a unit to a port without one, unconverted; the first: {}",
)
GEOMETRY = Limitation("SSP 2.0, 5.2.2", "geometry, notes and icons", "silent", "")

# ---- FMI, whatever version -------------------------------------------------------------------------------------------

FMI_VERSION = Limitation(
    "FMI",
    "drafts of FMI 3.0 (3.0-beta.3), and versions after 3.0",
    "error",
    'FMI "{}" is not supported; valid: fmiVersion="1.0", "2.0" and "3.0"',
)
EXCHANGE1 = Limitation(
    "FMI",
    "FMUs of FMI 1.0 for Model Exchange",
    "error",
    "is an FMU of FMI 1.0 for Model Exchange; of FMI 1.0 only co-simulation is supported",
)
SCHEDULED_EXECUTION = Limitation(
    "FMI 3.0.2, 5",
    "FMUs for Scheduled Execution only",
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
    "FMUs with neither a binary for this platform nor sources",
    "error",
    "has no library for this platform ({}); {}",
)
SOURCE_LIBRARY = Limitation(
    "FMI",
    "FMUs compiled from sources that link their own libraries",
    "error",
    '<Library> "{}" is not external: sources that need a library of the FMU\'s own are not supported',
)
LARGE_DESCRIPTION = Limitation(
    "FMI", "model descriptions of more than 128 MiB", "error", 'entry "{}" is larger than {} bytes'
)
ONLY_ONCE = Limitation(
    "FMI",
    "several instances of an FMU with canBeInstantiatedOnlyOncePerProcess: a run is one process",
    "error",
    "{} can be instantiated only once per process, but is used by {} and {}",
)
PYTHON_SOURCES = Limitation(
    "FMI",
    "Python FMUs (pythonfmu) with different modules of the same name, because they share an interpreter",
    "error",
    "was built from another {} than {}; both would share one; {}",
)
DISCARDED = Limitation(
    "FMI",
    "discarded steps, if an FMU cannot go back, or if steps of a thousandth of the size are discarded as well",
    "failure",
    "fmi{}Discard: it could not step from {} s to {} s{}; {}",
)
TOLERANCE = Limitation(
    "FMI", "tolerances, derivatives of outputs and directional derivatives in co-simulation", "silent", ""
)

# ---- FMI 2.0 ---------------------------------------------------------------------------------------------------------

PENDING = Limitation(
    "FMI 2.0.5, 4.2.2",
    "steps that continue in the background (fmi2Pending)",
    "failure",
    "fmi2Pending: it goes on in the background, which is not supported",
)

# ---- FMI 3.0 ---------------------------------------------------------------------------------------------------------

CLOCK_END = Limitation(
    "FMI 3.0.2, 2.4.7",
    "connections to time-based Clocks; connections from them to triggered Clocks are supported",
    "error",
    "{} is a {} Clock, which ticks by itself: it can drive a triggered input Clock, but {} is none",
)
SILENT_CLOCK = Limitation(
    "FMI 3.0.2, 2.4.7",
    "triggered Clocks without a connection",
    "note",
    "{}.{}: nothing is connected to this Clock: it never ticks",
)
TIED_STEPS = Limitation(
    "FMI 3.0.2, 2.4.7",
    "connections of Clocks between instances with different step sizes",
    "error",
    "instances that are connected by Clocks must have one step size, but step {}",
)
MISSED_TICK = Limitation(
    "FMI 3.0.2, 2.4.7",
    "Clocks that tick during a step of an FMU whose steps must have one size",
    "failure",
    "a Clock ticks at {} s, in the middle of a step, and it cannot take a shorter one",
)
CLOCKED_CHANGE = Limitation(
    "FMI 3.0.2, 2.4.7",
    "changes (--at) of clocked variables",
    "error",
    "it belongs to the Clock {}: it can be set only while that ticks",
)
STRUCTURAL_CHANGE = Limitation(
    "FMI 3.0.2, 2.4.7",
    "changes (--at) of structural parameters (reconfiguration)",
    "error",
    "it is a structural parameter, which sizes arrays: it can be set before the run only",
)
CLOCKED_PACKETS = Limitation(
    "FMI 3.0.2, 2.4.7",
    "MAVLink packets in variables that belong to a Clock",
    "note",
    '"{}" carries MAVLink packets but belongs to a Clock: it is not connected to the radio',
)
LARGE_VARIABLE = Limitation(
    "FMI 3.0.2, 2.4.7",
    "arrays of more than 1048576 elements",
    "error",
    'variable "{}" has {} elements; at most {} are possible',
)
WIDE_INTEGER = Limitation(
    "FMI 3.0.2, 2.4.7",
    "values of enumerations that need more than 32 bits and belong to no item",
    "failure",
    "an integer does not fit: the master carries 32 bits of an enumeration, and the variable may have fewer",
)
WIDE_ITEM = Limitation(
    "FMI 3.0.2, 2.4.7",
    "outputs, connected and set variables of enumerations with items that need more than 32 bits",
    "error",
    '{}.{} is an Enumeration whose item "{}" is {}; the master carries 32 bits of an enumeration',
)
UNSETTLED = Limitation(
    "FMI 3.0.2, 4.2",
    "events that need more than 100 iterations at one time",
    "failure",
    "{} do not settle in {} iterations at one time",
)
NO_MAX_SIZE = Limitation(
    "FMI 3.0.2, 2.4.7",
    "MAVLink packets in Binary variables without maxSize",
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
    "instances with several packet inputs, or outputs, for the radio",
    "error",
    "{} has several packet {}s for the radio, {}: one is valid",
)
SMALL_PORT = Limitation(
    "MAVLink",
    "packet inputs too small for the longest packet",
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
NO_AUTOPILOT = Limitation(
    "MAVLink",
    'ports (--ports) of components that are neither declared as autopilots nor named "autopilot"',
    "error",
    "no autopilot has packet ports: an FMU declares to be one, or its component is called {}; those that have are: {}",
)
SIGNATURE = Limitation(
    "MAVLink", "signatures of packets between instances, which are neither created nor checked", "silent", ""
)

# ---- multi-models of INTO-CPS ----------------------------------------------------------------------------------------

ALGORITHM = Limitation(
    "Multi-models", "algorithms of other types", "error", 'algorithm: its type is {}; valid: "fixed-step", "var-step"'
)
VAR_STEP = Limitation(
    "Multi-models",
    "stabilisation together with variable steps",
    "error",
    'stabilisation: loops are not iterated where constraints decide the steps; leave it out, or take "fixed-step"',
)
STABILISATION = Limitation(
    "Multi-models",
    "stabilisation that stops after a number of tries without convergence",
    "note",
    "{}: with stabilisation every loop is iterated to {}; Maestro stops after {} tries, settled or not",
)
TRANSFER = Limitation(
    "Multi-models", "transfer of models to another run", "error", "{}: model transfer is not supported"
)
SWAP = Limitation("Multi-models", "replacement of models during a run", "error", "{}: model swap is not supported")
FAULTS = Limitation("Multi-models", "fault injection", "error", "{}: fault injection is not supported")
LARGE_FILE = Limitation("Multi-models", "files of more than 64 MB", "error", "is larger than {} MB")
OTHER_KEYS = Limitation(
    "Multi-models",
    "settings of Maestro that only affect logging or display",
    "note",
    "{}: ignored, since it changes no values: {}",
)

# ---- OspSystemStructure.xml ------------------------------------------------------------------------------------------

OSP_ALGORITHM = Limitation(
    "OspSystemStructure",
    'the algorithm "ecco", whose steps vary',
    "error",
    '<Algorithm> is "{}"; valid: fixedStep',
)
OSP_BOND = Limitation(
    "OspSystemStructure",
    "power bonds, which only ecco uses",
    "note",
    'powerBond="{}" is ignored: only ecco uses it, and steps have one size',
)
# ---- writing for other engines ---------------------------------------------------------------------------------------

CONVERTED_LINK = Limitation(
    "Conversion",
    "sums, mapped values and packets recoded between versions of FMI; for libcosim connections to parameters",
    "error",
    "{} is {}: the file that is written cannot say this",
)
FMPY_TRANSFORMATION = Limitation(
    "Conversion",
    "for FMPy: connections with a factor or an offset, which FMPy does not apply",
    "error",
    "{}: FMPy applies no factor, offset or unit",
)
ENGINE_TYPES = Limitation(
    "Conversion",
    "connections of different types (libcosim, Ecos, OMSimulator), of Enumerations (libcosim), of texts (FMPy)",
    "error",
    "{} is {} and driven by {}, which {} does not connect",
)
ENGINE_FMI = Limitation(
    "Conversion",
    "for libcosim and FMPy: FMUs of FMI 3.0",
    "error",
    "{} is of FMI {}, which {} does not run in a system",
)

ENGINE_TABLE = Limitation(
    "Conversion",
    "components that are CSV or Parquet files, except linear CSV files for OMSimulator",
    "error",
    "{} is a file of values ({}), which {} does not read so",
)

# ---- masters ---------------------------------------------------------------------------------------------------------

FINE_STEPS = Limitation(
    "Masters",
    "step sizes without a common unit that is large enough for the run (fractions such as 1/30 are supported)",
    "error",
    "step size {} s: to count the time of this run exactly takes more than 62 bits; try {}",
)
WHOLE_TIMES = Limitation(
    "Masters",
    "start and stop times that are not whole nanoseconds",
    "error",
    "start and stop time must be whole nanoseconds",
)
BASE_STEP = Limitation(
    "Masters",
    "runs that end between two base steps",
    "error",
    "a run of {} s is not a multiple of the base step {} s; try --until {}",
)
OVERRUN = Limitation(
    "Masters",
    "runs that end during a step of an FMU whose steps must have one size",
    "error",
    "{} steps by {} s only (canHandleVariableCommunicationStepSize is false): a run of {} s is not a multiple of it",
)
RECORDING_INTERVAL = Limitation(
    "Masters",
    "recording between communication points",
    "error",
    "recording interval {} s is not a multiple of the base step {} s; try --set recording.interval={}",
)
CHANGE = Limitation(
    "Masters",
    "changes (--at) during a step",
    "error",
    "no step of {} begins then; its steps begin every {} s from {} to {} s",
)
NOT_A_NUMBER = Limitation(
    "Masters",
    'outputs that are NaN, unless the annotation org.uav-cosim.master of the system says nan="allow"',
    "failure",
    '{} is not a number; where that is meant, allow it: <master xmlns="https://uav-cosim.org/ns/1" nan="allow"/>',
)
INITIAL_LOOP = Limitation(
    "Masters",
    "loops at initialization that neither fixed-point iteration nor Newton's method solves",
    "failure",
    "these outputs depend on each other at initialization, and do not settle in {} rounds:",
)
CHECKPOINT = Limitation(
    "Masters",
    "checkpoints of systems with gateways, and with FMUs that cannot serialise their state",
    "error",
    "a run of this system has no checkpoints: {}",
)
EXTRAPOLATION = Limitation(
    "Masters",
    "extrapolated inputs other than Reals, of FMI 3, without canInterpolateInputs, or with iterating masters",
    "error",
    "{}.{} cannot be extrapolated: {}",
)
LOOP_STATE = Limitation(
    "Masters",
    "iterated loops with FMUs that cannot save their state",
    "error",
    "{}: {} is part of a loop, and canGetAndSetFMUstate of its FMU is false{}",
)
LOOP_EVENTS = Limitation(
    "Masters",
    "iterated loops with FMUs that have Event Mode",
    "error",
    "{}: {} is part of a loop, and its FMU has Event Mode, which cannot be iterated",
)
STEP_CONTROL = Limitation(
    "Masters",
    "variable steps with FMUs whose steps have one size; steps that the error decides, with FMUs that cannot go back",
    "error",
    "{}: {} of {} is false{}",
)
STEP_COUNTS = Limitation(
    "Masters",
    "steps by constraints, with FMUs that cannot go back: steps that violate a constraint count",
    "note",
    "var-step: canGetAndSetFMUstate of {} is false{}: a step that violates a constraint counts, it is not repeated",
)
STEP_EVENTS = Limitation(
    "Masters",
    "steps by constraints, with FMUs that have Event Mode beside FMUs that cannot go back",
    "error",
    "{}: {} has Event Mode, and an event within a step cannot be gone back to: canGetAndSetFMUstate of {} is false",
)
STEP_DELAY = Limitation(
    "Masters",
    "variable steps with delayed connections",
    "error",
    "{}: the connection to {} is delayed, which needs steps of one size",
)
STEP_FRACTION = Limitation(
    "Masters",
    "error-controlled steps with a base step that is not a whole number of ns",
    "error",
    "richardson: its rows lie on whole nanoseconds, but the base step is {} s; try --step with one that is whole",
)
FINE_GRID = Limitation(
    "Masters",
    "delays, or error-controlled steps, if the base step is far below the step of any instance",
    "error",
    "{} need each base step, {} s here, where the shortest step is {} s; try step sizes with a larger common divisor",
)

LIMITATIONS = tuple(value for value in tuple(globals().values()) if isinstance(value, Limitation))


_HAPPENS = {"error": "error", "failure": "the run fails", "note": "ignored, with a note", "silent": "ignored"}


def table() -> str:
    """Returns the tables of all limitations, one for each standard, in Markdown."""
    lines = [
        "# Limitations",
        "",
        "This page lists the features of the standards that `uav-cosim` does not support, and its messages. It is",
        "generated by `python -m cosim_master.diagnostics.limitations > docs/limitations.md` from the messages in the",
        "code; a test provokes every one of them.",
    ]
    for standard in dict.fromkeys(one.standard.partition(",")[0] for one in LIMITATIONS):
        rows = [one for one in LIMITATIONS if one.standard.partition(",")[0] == standard]
        with_sections = any(one.standard != standard for one in rows)
        head = "| section | feature " if with_sections else "| feature "
        lines += [
            "",
            f"## {standard}",
            "",
            f"{head}| behaviour | message |",
            "|---" * (3 + with_sections) + "|",
        ]
        for one in rows:
            section = f"| {one.standard.partition(', ')[2]} " if with_sections else ""
            words = f"`{one.words.replace('{}', '…')}`" if one.words else ""
            lines.append(f"{section}| {one.feature} | {_HAPPENS[one.outcome]} | {words} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(table())
