"""The reference of Python names: one page for each public name, by where it is imported from."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from sphinx.pycode import ModuleAnalyzer

from generators.words import first, said
from orientd import curves
from orientd.errors import OrientdError

FRONTS = {
    "orientd": "What most programs need.",
    "orientd.client": "What `orientd.connect` returns; its calls return messages of the protocol.",
    "orientd_bluesky": "Devices for programs of other systems.",
    "orientd_fleet": "Several daemons as one cell.",
    "orientd.protocol": "What turns the messages of the protocol into values and back.",
    "orientd.curves": "Every family of curves, behind one contract, and what they are made of.",
    "orientd.planner": "From a request to an immutable motion with its certificate.",
    "orientd.model": "What a motion request is made of.",
    "orientd.plots": "Pictures of curves and motions; they need Matplotlib.",
    "orientd.driver": "What a device must do for the servo, and how it is found.",
    "orientd.mechanism": "Axes with limits that pose a tool: what a driver hands to the planner.",
    "orientd.testing": "A conformance suite for drivers.",
    "orientd.errors": "Every error that orientd raises, and the kinds of fault of a device.",
}
CHOSEN = {
    "orientd.client": [
        "move_handle.MoveHandle",
        "tracking.Tracking",
        "tracking.TrackTiming",
        "pointing.Pointing",
        "pointing.BaseReport",
        "clutch.Clutch",
        "teaching.Teaching",
        "teaching.MeasuredPose",
        "motion_text.RequestFields",
        "observer.Observer",
    ],
    "orientd_bluesky": ["RotationAxis", "FlyScan", "MotionStatus"],
    "orientd_fleet": [
        "client.connect_fleet",
        "client.Fleet",
        "client.Stopped",
        "together.FleetMotion",
        "together.move_together",
        "together.Together",
    ],
    "orientd.model": [
        "limits.ANGULAR",
        "limits.AXES",
        "limits.NO_AXES",
        "limits.Rate",
        "limits.UNITS",
        "request.DEFAULT_METHOD",
        "request.named_frames",
    ],
    "orientd.protocol": [
        "CellReport",
        "Samples",
        "quaternion",
        "to_quaternion",
        "vector",
        "to_vector",
        "plain",
    ],
    "orientd.curves": [
        *curves.__all__,
        "axis_turn.AxisTurn",
        "comparison.Candidate",
        "comparison.Figures",
        "comparison.MET",
        "comparison.compare",
        "comparison.measure",
        "comparison.ranked",
        "fitting.Fit",
        "fitting.describe_bursts",
        "fitting.fit_orientations",
        "hermite.KksHermite",
        "interpolating.C2Cumulative",
        "interpolating.KksInterpolating",
        "products.KksBspline",
    ],
    "orientd.planner": [
        "planning.plan",
        "certify.certificate.Certificate",
        "certify.certificate.Peak",
        "blending.NOT_BLENDED",
        "blending.blend",
        "certifying.reshaped",
        "device_planner.DevicePlanner",
        "facts.HISTORY",
        "facts.MOTION_RECORD",
        "facts.MotionFacts",
        "methods.check_method",
        "methods.curve_of",
        "offline.in_parallel",
        "offline.need_backend",
        "path.PathSamples",
        "path.position_path",
        "recorded.RecordedMotion",
        "recorded.rows_of",
        "recorded.start_of",
        "recorded.states_between",
        "resolve.in_device_coordinates",
        "resolve.report_frame",
        "task.distinct",
        "task.plan_as_recorded",
        "task.replay_request",
        "task.task_of",
    ],
    "orientd.plots": ["Picture", "draw", "draw_sheet", "picture"],
    "orientd.mechanism": ["Gimbal", "Mechanical", "Mechanism", "Reserve"],
    "orientd.testing": ["DriverConformance"],
}
"""The public names of a package, with the modules to import them from.  Else all of ``__all__``."""


def pages(source: Path) -> Iterator[tuple[str, str]]:
    """Yield a page for each public name, and one for each package."""
    del source
    for front, says in FRONTS.items():
        module = import_module(front)
        names = _names(module, front)
        listed = []
        for name in names:
            home, _, own = f"{front}.{name}".rpartition(".")
            line, text = _page(home, own, getattr(import_module(home), own))
            yield f"reference/python/{front}.{name}.rst", text
            listed.append(f"| [`{name}`]({front}.{name}.rst) | {line} |")
        doc = "" if front in ("orientd", "orientd.errors") else first(module, front)
        tree = ["```{eval-rst}", inspect.getdoc(module) or "", "```", ""]
        parts = [f"# `{front}`", "", says, "", doc, "", *(tree if "errors" in front else ())]
        parts += ["| name | meaning |", "|---|---|", *listed, ""]
        parts += _contents(f"{front}.{name}" for name in names)
        yield f"reference/python/{front}.md", "\n".join(parts)
    listed = [f"| [`{front}`]({front}.md) | {says} |" for front, says in FRONTS.items()]
    parts = ["# Python", "", "| package | holds |", "|---|---|", *listed, "", *_contents(FRONTS)]
    yield "reference/python/index.md", "\n".join(parts)


def _names(module: Any, front: str) -> list[str]:  # noqa: ANN401 - a module
    if front in CHOSEN:
        return CHOSEN[front]
    if front == "orientd.errors":
        return [
            name
            for name, one in vars(module).items()
            if inspect.isclass(one)
            and (issubclass(one, OrientdError) or name in {"Fault", "LimitKind"})
        ]
    return [
        name
        for name in module.__all__
        if name != "__version__" and not inspect.ismodule(getattr(module, name))
    ]


def _contents(names: Iterable[str]) -> list[str]:
    return ["```{toctree}", ":hidden:", "", *names, "```", ""]


def _page(front: str, name: str, found: Any) -> tuple[str, str]:  # noqa: ANN401
    title = f"{name}\n{'=' * len(name)}\n\n.. py:currentmodule:: {front}\n\n"
    if hasattr(found, "DESCRIPTOR"):
        fields = ", ".join(f"``{field.name}``" for field in found.DESCRIPTOR.fields)
        line = "A message of the protocol; its fields are keyword arguments."
        where = "The :doc:`protocol </reference/protocol>` says what each is."
        return line, f"{title}{line}\n\n.. py:class:: {name}\n\n   {fields}.\n\n{where}\n"
    if inspect.isclass(found) and not hasattr(found, "__origin__"):
        return first(found, f"{front}.{name}"), f"{title}.. autoclass:: {front}.{name}\n"
    if inspect.isroutine(found):
        return first(found, f"{front}.{name}"), f"{title}.. autofunction:: {front}.{name}\n"
    text = _comment(front, name)
    value = repr(found)
    shown = f"   :value: {value}\n" if len(value) < 60 else ""
    body = text.replace("\n", "\n   ")
    return said(text.split("\n\n")[0]), f"{title}.. py:data:: {name}\n{shown}\n   {body}\n"


def _comment(front: str, name: str) -> str:
    """Return what the module that a constant is from says below it.

    Raises:
        ValueError: it says nothing; so the build fails.
    """
    home = front
    while name in dict(_homes(home)):
        home = dict(_homes(home))[name]
    comments = ModuleAnalyzer.for_module(home).find_attr_docs().get(("", name))
    if not comments:
        raise ValueError(f"{front}.{name} is public and nothing says what it is")
    return "\n".join(comments).strip()


def _homes(front: str) -> Iterator[tuple[str, str]]:
    """Yield the names that a front imports, with the modules that they are from."""
    source = Path(str(import_module(front).__file__)).read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from ((one.asname or one.name, node.module) for one in node.names)
