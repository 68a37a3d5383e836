"""What Rerun shows of an exported log at first: robot, eyes, plots and events."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from common.robot.joints import JOINT_NAMES
from common.topics import ALL_TOPICS
from services.logger.export.ros import camera_frame
from services.logger.export.spatial import WORLD_FRAME

RED, BLUE, ORANGE, GREY = (225, 87, 89), (78, 121, 167), (242, 142, 43), (128, 128, 128)
_PERIODIC = frozenset(topic.name for topic in ALL_TOPICS if topic.rate > 0.0)


def blueprint(topics: Iterable[str]) -> rrb.Blueprint:
    """The layout for an exported file with these ``topics``."""
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
        rrb.TimePanel(timeline="message_log_time", state="collapsed"),
        collapse_panels=True,
    )


def _robot() -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        name="robot, measured; spheres: hand set-points",
        origin="/",
        contents=["/robot/**", "/tf", "/hands/**", "/base/**"],
        spatial_information=rrb.SpatialInformation(WORLD_FRAME),
        eye_controls=rrb.EyeControls3D(
            position=(2.3, -1.9, 1.5), look_target=(0.1, 0.0, 0.65), eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={"/base/measured": rr.TransformAxes3D(0.2)},
    )


def _eye(side: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        name=f"{side} eye",
        origin=f"/camera/{side}",
        spatial_information=rrb.SpatialInformation(camera_frame(side)),
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
    curves = {
        f"/hands/{side}/{what}": [_coordinate(2, f"{side} {what}", colour)]
        for side, colours in (("left", (GREY, BLUE)), ("right", (GREY, ORANGE)))
        for what, colour in zip(("setpoint", "measured"), colours, strict=True)
    }
    return _plot("hand height in torso_link: set-point and measured [m]", curves)


def _joints() -> rrb.TimeSeriesView:
    legs = ["/joints/measured/position"]
    return _plot(f"the {len(JOINT_NAMES)} joints measured [rad]", {}, contents=legs)


def _ages(links: Sequence[str]) -> rrb.TimeSeriesView:
    """How old the inputs of each service are; events have no age that would mean anything."""
    shown = [link for link in links if link.split("/", 3)[3] in _PERIODIC]
    curves = {
        link: [_curve("LinkPlot", ".age", link.removeprefix("/links/").replace("/", " < ", 1))]
        for link in shown
    }
    return _plot("age of inputs [s]", curves)


def _plot(
    name: str, curves: Mapping[str, Sequence[Any]], contents: Sequence[str] | None = None
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=name,
        contents=list(curves) if contents is None else list(contents),
        overrides={entity: list(several) for entity, several in curves.items()},
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
    )


def _curve(
    schema: str, selector: str, name: str, colour: tuple[int, int, int] | None = None
) -> Any:
    """A curve of the number that a selector, in the manner of jq, finds in a ``schema``."""
    return rr.SeriesLines(names=name, colors=colour).visualizer(
        mappings=[_mapping("Scalars:scalars", f"trill.{schema}:message", selector)]
    )


def _coordinate(axis: int, name: str, colour: Any) -> Any:
    return rr.SeriesLines(names=name, colors=colour).visualizer(
        mappings=[_mapping("Scalars:scalars", "InstancePoses3D:translations", f".[{axis}]")]
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
