"""Defines the initial layout in Rerun: robot, cameras, plots and events."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from common.robot.joints import JOINT_NAMES
from common.topics import ALL_TOPICS
from services.logger.export.robot import camera_frame
from services.logger.export.spatial import WORLD_FRAME

RED, BLUE, ORANGE = (225, 87, 89), (78, 121, 167), (242, 142, 43)
_PLANE = "_image_plane"
"""Suffix that Rerun's importer adds to the frame of a CompressedImage."""
_PERIODIC = frozenset(topic.name for topic in ALL_TOPICS if topic.rate > 0.0)


def blueprint(topics: Iterable[str]) -> rrb.Blueprint:
    """Return the layout for an exported file with these ``topics``."""
    links = [one for one in topics if one.startswith("/links/")]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_robot(), rrb.Horizontal(_eye("left"), _eye("right")), row_shares=[3, 2]),
            rrb.Vertical(
                _states(),
                _errors(),
                _hands(),
                _joints(),
                _ages(links),
                rrb.TextLogView(origin="/events", name="events"),
                row_shares=[3, 4, 4, 4, 4, 3],
            ),
        ),
        collapse_panels=True,
    )


def _robot() -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        name="robot, measured; spheres: hand set-points",
        origin="/",
        contents=["/robot/**", "/tf", "/hands/**", "/base/**"],
        spatial_information=rrb.SpatialInformation(WORLD_FRAME),
        eye_controls=rrb.EyeControls3D(
            position=(1.7, -1.4, 1.2), look_target=(0.1, 0.0, 0.62), eye_up=(0.0, 0.0, 1.0)
        ),
    )


def _eye(side: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name=f"{side} camera",
        origin=f"/camera/{side}",
        spatial_information=rrb.SpatialInformation(f"{camera_frame(side)}{_PLANE}"),
    )


def _states() -> rrb.StateTimelineView:
    lanes = {
        "/wbc/state": [_lane("ControllerState", "state"), _lane("ControllerState", "gait")],
        "/plant/status": [_lane("PlantStatus", "guard")],
    }
    return rrb.StateTimelineView(
        name="controller, gait, guard", contents=list(lanes), overrides=lanes
    )


def _errors() -> rrb.TimeSeriesView:
    errors = [("dcm_error", "DCM", RED), ("hand_position_error[0]", "left hand", BLUE)]
    errors += [("hand_position_error[1]", "right hand", ORANGE)]
    curves = [_curve("ControllerState", f".{path}", name, c) for path, name, c in errors]
    return _plot("errors [m]", {"/wbc/state": curves})


def _hands() -> rrb.TimeSeriesView:
    curves = [
        _curve("Setpoint", f".{side}_hand_position_in_body[{axis}]", f"{side} {name}")
        for side in ("left", "right")
        for axis, name in enumerate("xyz")
    ]
    return _plot("hand set-points in torso_link [m]", {"/teleop/setpoint": curves})


def _joints() -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=f"the {len(JOINT_NAMES)} joints, measured [rad]",
        origin="/joints/measured/position",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
    )


def _ages(links: Sequence[str]) -> rrb.TimeSeriesView:
    """Plot the age of each service's periodic inputs; the age of an event means nothing."""
    shown = [link for link in links if link.split("/", 3)[3] in _PERIODIC]
    curves = {
        link: [_curve("LinkPlot", ".age", link.removeprefix("/links/").replace("/", " < ", 1))]
        for link in shown
    }
    return _plot("age of inputs [s]", curves)


def _plot(name: str, curves: Mapping[str, Sequence[Any]]) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=name,
        contents=list(curves),
        overrides={entity: list(several) for entity, several in curves.items()},
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
    )


def _curve(
    schema: str, selector: str, name: str, colour: tuple[int, int, int] | None = None
) -> Any:
    """Return a curve of the number that a jq-like selector finds in a ``schema``."""
    return rr.SeriesLines(names=name, colors=colour).visualizer(
        mappings=[_mapping("Scalars:scalars", f"trill.{schema}:message", selector)]
    )


def _lane(schema: str, field: str) -> Any:
    return rr.StateChange().visualizer(
        mappings=[_mapping("StateChange:state", f"trill.{schema}:message", f".{field}.name")]
    )


def _mapping(target: str, component: str, selector: str) -> VisualizerComponentMapping:
    return VisualizerComponentMapping(
        target,
        ComponentSourceKind.SourceComponent,
        source_component=component,
        selector=selector,
    )
