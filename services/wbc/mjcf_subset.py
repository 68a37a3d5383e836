"""The part of MJCF that MuJoCo and pinocchio read alike; anything else in the robot is refused.

The plant and the controller read one file with two libraries. Pinocchio ignores, without a word,
some of what MuJoCo obeys: angles in degrees, gravity, a second tree, a body's missing name, frames.
The controller would then balance another robot than the one it commands.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path

from common.robot.frames import BASE_JOINT, BODY_FRAME
from services.wbc.errors import ModelError

COMPILER = {"angle": "radian", "autolimits": "true", "inertiafromgeom": "false"}
SECTIONS = frozenset(
    ("compiler", "default", "worldbody", "asset", "contact", "tendon", "equality", "actuator")
)
LOOKS = frozenset(("geom", "site", "camera"))
"""Elements of a body that do not move it."""
ATTRIBUTES: Mapping[str, frozenset[str]] = {
    "body": frozenset(("name", "pos", "quat", "childclass")),
    "inertial": frozenset(("pos", "mass", "fullinertia")),
    "joint": frozenset(("name", "class", "axis", "range")),
    "freejoint": frozenset(("name",)),
}
JOINT_DEFAULTS = frozenset(
    ("type", "armature", "damping", "frictionloss", "range", "solreflimit", "class")
)


def check_mjcf(path: Path) -> None:
    """Check that a robot's MJCF uses only what both libraries read alike.

    Raises:
        ModelError: it does not; the message names the element.
    """
    root = ET.parse(path).getroot()
    problems = [*_in_sections(root), *_in_tree(root)]
    if problems:
        raise ModelError(
            f"{path}: pinocchio and MuJoCo would read different robots, for {'; '.join(problems)}. "
            "Write the robot in radians, with named bodies in one floating tree, each with its "
            "inertial and at most one joint, and put gravity and world into the scene"
        )


def _in_sections(root: ET.Element) -> Iterator[str]:
    for section in root:
        if section.tag not in SECTIONS:
            yield f"it has <{section.tag}>"
    compilers = [dict(compiler.attrib) for compiler in root.findall("compiler")]
    if compilers != [COMPILER]:
        yield f"its compiler settings are {compilers}, expected {COMPILER}"
    for joint in root.iterfind("default//joint"):
        for name in sorted(set(joint.attrib) - JOINT_DEFAULTS):
            yield f"a default of <joint> sets {name!r}"


def _in_tree(root: ET.Element) -> Iterator[str]:
    world = [child for section in root.findall("worldbody") for child in section]
    names = [child.get("name", f"<{child.tag}>") for child in world]
    if names != [BODY_FRAME]:
        yield f"<worldbody> holds {names}, expected the one tree {[BODY_FRAME]}"
        return
    if [joint.get("name") for joint in world[0].findall("freejoint")] != [BASE_JOINT]:
        yield f"{BODY_FRAME!r} has no <freejoint name={BASE_JOINT!r}>"
    for body in world[0].iter("body"):
        yield from _in_body(body)


def _in_body(body: ET.Element) -> Iterator[str]:
    name = body.get("name")
    where = f"body {name!r}" if name else f"a body without a name at {body.get('pos')!r}"
    if not name:
        yield where
    for element in (body, *body):
        if element.tag not in ATTRIBUTES and element.tag not in LOOKS:
            yield f"{where} holds <{element.tag}>"
            continue
        known = ATTRIBUTES.get(element.tag, frozenset(element.attrib))
        for attribute in sorted(set(element.attrib) - known):
            yield f"{where} has {attribute!r} in <{element.tag}>"
    if len(body.findall("inertial")) != 1:
        yield f"{where} has no <inertial>, or several"
    if len([*body.findall("joint"), *body.findall("freejoint")]) > 1:
        yield f"{where} has several joints"
