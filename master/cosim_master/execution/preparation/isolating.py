"""The FMUs of a run that have processes of their own, decided before any FMU is loaded."""

from __future__ import annotations

import logging
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast, get_args

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import ONLY_ONCE
from cosim_master.diagnostics.names import matching, near_pattern
from cosim_master.fmi.isolation.building import CannotIsolate, binaries, connecting, portable, shares_memory
from cosim_master.fmi.isolation.child import TOKEN
from cosim_master.fmi.isolation.remote import Address
from cosim_master.fmi.slaves.isolated import Isolation, Scope, isolable
from cosim_master.system.flatten.flat import CheckedSystem

__all__ = ["chosen_isolation", "isolation_for"]

log = logging.getLogger(__name__)

DEFAULT = Isolation()
STATE_FLAGS = ("canGetAndSetFMUstate", "canSerializeFMUstate")


def chosen_isolation(
    scope: str | None,
    seconds: float | None,
    mebibytes: int | None,
    restarts: int | None = None,
    hosts: Sequence[str] | None = None,
) -> Isolation | None:
    """Returns the isolation that --isolate, --step-timeout, --memory-limit, --restart-crashed and --host select.

    Returns:
        None without any of them: the default.

    Raises:
        SystemDescriptionError: the scope is unknown, a host is not INSTANCE=MACHINE:PORT, or there is no token for it.
    """
    if (scope, seconds, mebibytes, restarts, hosts or None) == (None,) * 5:
        return None
    scopes = get_args(Scope)
    if scope is not None and scope not in scopes:
        text = f'"{scope}" is not one of {", ".join(scopes)}'
        raise SystemDescriptionError([Problem(Where("--isolate"), text)])
    limits = DEFAULT.limits
    if seconds is not None:
        limits = replace(limits, seconds=seconds)
    if mebibytes is not None:
        limits = replace(limits, memory=mebibytes << 20)
    if restarts is not None:
        limits = replace(limits, restarts=restarts)
    addresses = _addresses(hosts or ())
    token = os.environ.get(TOKEN, "")
    if addresses and not token:
        text = f"the environment variable {TOKEN} is not set; it holds the token that `uav-cosim serve` shows"
        raise SystemDescriptionError([Problem(Where("--host"), text)])
    return Isolation(cast(Scope, scope or DEFAULT.scope), limits, hosts=addresses, token=token)


def _addresses(hosts: Sequence[str]) -> dict[str, Address]:
    """Returns the addresses in texts INSTANCE=MACHINE:PORT by instance or pattern."""
    found, problems = {}, []
    for text in hosts:
        name, _, place = text.partition("=")
        try:
            found[name] = Address.parsed(place)
        except ValueError as error:
            problems.append(Problem(Where("--host"), f'"{text}" is not INSTANCE=MACHINE:PORT: {error}'))
    if problems:
        raise SystemDescriptionError(problems)
    return found


def _hosted(hosts: Mapping[str, Address], checked: CheckedSystem) -> dict[str, Address]:
    """Returns the addresses by the names of instances; a name precedes patterns, and later patterns earlier ones.

    Raises:
        SystemDescriptionError: a pattern selects no instance, or one whose FMU cannot run on another machine.
    """
    found: dict[str, Address] = {}
    problems = []
    names = {one.name: one for one in checked.instances}
    for pattern, address in sorted(hosts.items(), key=lambda item: item[0] in names):
        selected = [pattern] if pattern in names else matching(pattern, names)
        if not selected:
            text = f'"{pattern}" is no instance; {near_pattern(pattern, names)}'
            problems.append(Problem(Where("--host"), text))
        for name in selected:
            found[name] = address
            if not isolable(names[name].fmu):
                text = f"{name} cannot run on {address}: tables and FMUs of FMI 1 run in the process of the run"
                problems.append(Problem(names[name].where, text))
    if problems:
        raise SystemDescriptionError(problems)
    return found


def isolation_for(chosen: Isolation | None, checked: CheckedSystem) -> Isolation:
    """Returns the isolation of a run.

    Args:
        chosen: as the user wants it; with "foreign", annotations of the system apply. None: the default, which does
            without processes where they are not available.

    Raises:
        SystemDescriptionError: processes are wanted and not available, or an FMU that can be instantiated only once
            per process has several instances in one, or a process has to be started anew and cannot be.
    """
    isolation = chosen or DEFAULT
    if isolation.hosts:
        isolation = replace(isolation, hosts=_hosted(isolation.hosts, checked))
    if chosen is None or chosen.scope == "foreign":
        isolation = replace(isolation, wishes={i.name: i.process for i in checked.instances if i.process})
        if not isolation.limits.restarts:
            isolation = replace(isolation, restarts=_restarts(isolation, checked))
    if any(isolation.isolates(i.fmu, i.name) for i in checked.instances):
        try:
            _ready(isolation, wanted=chosen is not None)
        except CannotIsolate as error:
            if chosen is not None:
                raise SystemDescriptionError([Problem(Where("--isolate"), str(error))]) from None
            log.warning("note: FMUs run in this process, whose crash would end the run: %s", error)
            isolation = replace(isolation, scope="none", wishes={})
    _refuse_restarts(isolation, checked)
    if isolation.scope == "all":
        for fmu in {i.fmu.path: i.fmu for i in checked.instances}.values():
            if fmu.table is None and not isolable(fmu):
                log.warning("note: %s runs in this process: FMUs of FMI 1 are not isolated", fmu.path.name)
    problems = []
    only_once: dict[str, str] = {}
    for instance in checked.instances:
        fmu = instance.fmu
        if not fmu.capabilities.canBeInstantiatedOnlyOncePerProcess or isolation.isolates(fmu, instance.name):
            continue
        other = only_once.setdefault(fmu.digest, instance.name)
        if other != instance.name:
            text = ONLY_ONCE.text(fmu.path.name, other, instance.name)
            problems.append(Problem(instance.where, text))
    if problems:
        raise SystemDescriptionError(problems)
    return isolation


def _ready(isolation: Isolation, *, wanted: bool) -> None:
    """Finds or compiles the C part of processes.

    Raises:
        CannotIsolate: there is none, or nobody has asked for processes where they have not been tried.
    """
    if shares_memory() or isolation.hosts:
        binaries()
    elif wanted:
        connecting("")
        portable("")
    else:
        raise CannotIsolate(f"processes of FMUs have not been tried on {platform.system()}; try --isolate foreign")


def _restarts(isolation: Isolation, checked: CheckedSystem) -> dict[str, int]:
    """Returns how often the system lets each process be started anew, by instance: the most of those that share it."""
    most: dict[str, int] = {}
    for one in checked.instances:
        if one.restarts:
            each = isolation.each(one.fmu, one.name)
            for other in [one] if each else [i for i in checked.instances if i.fmu.path == one.fmu.path]:
                if each or not isolation.each(other.fmu, other.name):
                    most[other.name] = max(one.restarts, most.get(other.name, 0))
    return most


_NONE_ISOLATED = "no FMU of this system runs in a process of its own; --isolate all isolates every one"


def _refuse_restarts(isolation: Isolation, checked: CheckedSystem) -> None:
    """Raises SystemDescriptionError if a process has to be started anew, and its FMUs have no state to go on from."""
    problems, isolated = [], False
    for one in checked.instances:
        if not isolation.isolates(one.fmu, one.name):
            continue
        isolated = True
        if not isolation.limits_of(one.name).restarts:
            continue
        lacking = [flag for flag in STATE_FLAGS if not getattr(one.fmu.capabilities, flag)]
        if lacking or one.fmu.model_exchange is not None:
            reason = f"{lacking[0]} is false{one.fmu.remedy(lacking[0])}" if lacking else "it is for Model Exchange"
            text = f"{one.name} cannot be started anew after a crash (--restart-crashed): {reason}"
            problems.append(Problem(one.where, text))
    if isolation.limits.memory != DEFAULT.limits.memory and not isolated:
        log.warning("note: --memory-limit limits nothing: %s", _NONE_ISOLATED)
    if isolation.limits.restarts and not isolated:
        text = _NONE_ISOLATED
        problems.append(Problem(Where("--restart-crashed"), text))
    if problems:
        raise SystemDescriptionError(problems)
