"""The master knows no model: no name of a parameter, a port or a class of our models stands in its sources.

The names come from the model classes. Names that are made for models are looked for in the whole text, comments and
docstrings as well. Those that are plain words (`step`, `target`) are looked for in texts that programs compare: string
constants without a space that are no docstrings.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import cosim_master
from cosim.build import models_of_package

MASTER = Path(cosim_master.__file__).parent
MODELS = models_of_package("cosim_models")
NAMES = {v.name for model in MODELS for v in model.variables if v.kind != "Memory" and v.role != "state"}
OF_PACKETS = {v.name for model in MODELS for v in model.variables if v.kind == "Packets"}
CLASSES = {model.__name__ for model in MODELS}

ANYWHERE = {
    "airframe": "a word",
    "ahead": "a word",
    "altitude": "a figure",
    "armed": "a verdict's role",
    "attach": "a verb of ctypes and of debuggers",
    "attitude": "a word",
    "behind": "a word",
    "boxes": "of figures",
    "capacity": "of packet ports",
    "cell": "of a table",
    "cells": "of tables",
    "circle": "of figures",
    "clock": "of FMI",
    "command": "of the command line",
    "contact": "a finding of the verdict",
    "cost": "a word",
    "count": "a word; of drones, by the convention of Swarm.environment",
    "current": "a word",
    "cylinders": "a word",
    "defaults": "a word",
    "distance": "a word",
    "executable": "a word",
    "failure": "a severity",
    "folder": "a word",
    "force": "an option",
    "form": "a word",
    "gain": "of a law's term",
    "goal": "a word",
    "heading": "of a text",
    "identity": "of an array",
    "inertia": "a word",
    "instance": "of FMI",
    "lost": "packets",
    "mass": "a word",
    "members": "of an archive, of a group",
    "memory": "of a process, and of an instance",
    "mode": "of FMI",
    "motor": "a word",
    "nearest": "a topology of the network",
    "neighbours": "of the network, and a word",
    "peak": "a word",
    "period": "of stepping, and an attribute of the annotation of verdicts",
    "radius": "a word",
    "refusal": "a word",
    "restarts": "a word",
    "seed": "of the network",
    "spacing": "of a layout",
    "speed": "a word",
    "speedup": "a word",
    "state": "of an FMU",
    "substep": "of a solver",
    "terrain": "a word",
    "timeout": "a word",
    "trigger": "a word",
    "velocity": "a word",
    "wind": "a word",
}
"""Plain words that also name variables of ours, and as what they are known here."""
IN_FILES = {
    "position": {
        "execution/run/checkpoint.py": "of the recorder in its files",
        "results/export/foxglove_layout.py": "field of PoseInFrame",
        "results/storage/checkpoint_folder.py": "of the recorder in its files",
        "system/settings/network.py": "attribute of the annotation of networks",
        "view/programs/foxglove_server.py": "key of the columns of a vehicle",
        "view/motion.py": "key of the page's document",
    },
    "step": {
        "campaigns/running/options.py": "option",
        "campaigns/study/study.py": "key of a study",
        "cli/terminal/options.py": "option",
        "cli/verbs/systems.py": "counted in a text",
        "execution/options.py": "option",
        "execution/outcome/manifest.py": "key of the manifest",
        "fmi/description/declarations.py": "attribute of the annotation of verdicts",
        "network/gateways/gateways.py": "of port numbers",
        "report/contents.py": "key of the manifest",
        "report/structure.py": "key of the manifest",
        "results/reading/comparison.py": "key of the manifest",
        "results/figures/steps.py": "label of an axis",
        "system/flatten/component_settings.py": "attribute of the annotation of solvers",
        "system/reading/others/into_cps.py": "fixed-step",
        "system/reading/others/var_step.py": "var-step",
        "system/settings/master.py": "var-step",
        "system/settings/time_grid.py": "option",
        "view/live/server.py": "request of a live page",
    },
    "target": {
        "cli/views/overview.py": "column of packets.parquet",
        "fmi/isolation/building.py": "option of the C compiler",
        "network/radio/queues.py": "field of packets in flight",
        "network/radio/tables.py": "field of packets in flight",
        "results/export/tlog.py": "column of packets.parquet",
        "results/reading/links.py": "column of packets.parquet",
        "results/storage/parquet.py": "column of packets.parquet",
        "results/recording/packet_log.py": "column of packets.parquet",
        "system/authoring/text/ssp_text.py": "attribute of SSP",
        "system/reading/ssp/grammar.py": "attribute of SSP",
        "system/reading/ssp/ssc.py": "attribute of SSP",
        "system/reading/ssp/ssv.py": "attribute of SSP",
        "system/settings/radio/own_channel.py": "field of the syntax tree of Python",
        "verdict/monitors/ages.py": "field of packets in flight",
        "view/live/traffic.py": "field of packets in flight",
        "view/traffic.py": "column of packets.parquet",
    },
}
"""Words that once meant a model's variable, where they mean something else, and what."""
_TERRAIN = "a parameter that models with a terrain share, whose values users set"
EXAMPLES = "an example in a help text, for people who type it"
JUSTIFIED = {
    ("epsilon", "cli/verbs/run.py"): EXAMPLES,
    ("epsilon", "cli/verbs/sweep.py"): EXAMPLES,
    ("epsilon", "cli/verbs/systems.py"): EXAMPLES,
    ("epsilon", "cli/views/explanation.py"): "an example in a docstring",
    ("epsilon", "campaigns/study/factors.py"): "an example in a docstring",
    ("sysid", "view/programs/ros/mavlink.py"): "field of mavros_msgs/Mavlink",
    ("sysid", "view/programs/ros/ros1.py"): "field of mavros_msgs/Mavlink",
    ("sysid", "view/programs/ros/ros2_types.py"): "field of mavros_msgs/Mavlink",
    ("setpoint_position", "view/programs/ros/setpoints.py"): "a topic of mavros",
    ("setpoint_velocity", "view/programs/ros/setpoints.py"): "a topic of mavros",
    ("position_start", "cli/verbs/systems.py"): EXAMPLES,
    ("Hexarotor", "cli/verbs/editing.py"): EXAMPLES,
    ("Quadrotor", "cli/verbs/build.py"): EXAMPLES,
    ("Quadrotor", "cli/verbs/results.py"): EXAMPLES,
    ("WPNAV_SPEED", "system/flatten/check.py"): "an example in a docstring",
    ("mavlink_rx", "stepping/kernels/macro_step.py"): "the diagram of a macro step, as in ARCHITECTURE.md",
    ("mavlink_tx", "stepping/kernels/macro_step.py"): "the diagram of a macro step, as in ARCHITECTURE.md",
    ("step_timeout", "cli/verbs/run.py"): "an option, the limit of a step in a process of its own",
    ("terrain_origin", "system/authoring/terrain.py"): _TERRAIN,
    ("terrain_spacing", "system/authoring/terrain.py"): _TERRAIN,
}
"""Names that are made for models, by the file that may have them, and why."""


@cache
def sources() -> dict[str, str]:
    return {path.relative_to(MASTER).as_posix(): path.read_text("utf-8") for path in sorted(MASTER.rglob("*.py"))}


def compared(text: str) -> list[str]:
    """Words of string constants without a space that are no docstrings."""
    words, documents = [], set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr):  # comes before its value
            documents.add(id(node.value))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and " " not in node.value:
            words += [] if id(node) in documents else re.findall(r"\w+", node.value)
    return words


def test_names_made_for_models_stand_nowhere() -> None:
    made = (NAMES | CLASSES) - ANYWHERE.keys() - IN_FILES.keys()
    assert {"left_sysid", "stubborn", "epsilon", "SYSID_THISMAV", "telemetry_rx", "LineAgent"} <= made
    found = {(word, file) for file, text in sources().items() for word in set(re.findall(r"\w+", text)) & made}
    assert found == JUSTIFIED.keys(), "declare it (cosim/verdict.py) or follow the convention (cosim/vehicle.py)"


def test_plain_words_are_compared_with_no_variable() -> None:
    assert (ANYWHERE.keys() | IN_FILES.keys()) <= NAMES
    words = {(word, file) for file, text in sources().items() for word in compared(text) if word in IN_FILES}
    assert words == {(word, file) for word, files in IN_FILES.items() for file in files}


def test_the_convention_of_names_stands_in_one_place() -> None:
    from cosim.naming import LINES

    conventional = {name for pair in LINES.values() for name in pair}
    assert conventional < OF_PACKETS
    assert not any(name in text for name in conventional for text in sources().values())
