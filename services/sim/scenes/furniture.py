"""The table under the objects of the hardware tasks."""

from typing import Any, Final

from services.sim.scenes.base import Quantity
from services.sim.scenes.parts import collision_geom, visual_geom

TABLE_TOP: Final = 0.74
"""Height of the table's surface [m]: 8 cm below the standing robot's torso frame."""
TABLE_EDGE: Final = 0.27
"""World x of the edge before the robot [m]: only hands and palms are above the table."""

TABLE_GRIP = Quantity("table, sliding friction", 0.6, "", "varnished wood")
TABLE_QUANTITIES: Final = (TABLE_GRIP,)
FURNITURE_COLOURS: Final = {
    "wall": (0.70, 0.78, 0.80, 0.05),
    "skirting": (0.93, 0.92, 0.89, 0.2),
    "table": (0.72, 0.54, 0.34, 0.3),
    "table_edge": (0.55, 0.39, 0.22, 0.3),
    "leg": (0.20, 0.21, 0.23, 0.5),
    "cloth": (0.24, 0.31, 0.36, 0.1),
}


def add_table(spec: Any) -> None:
    """Add a table of 0.45 x 1.2 m, its near edge at :data:`TABLE_EDGE`."""
    world = spec.worldbody
    half = (0.225, 0.6, 0.015)
    x = TABLE_EDGE + half[0]
    friction = (TABLE_GRIP.value, 0.005, 0.0001)
    top = (x, 0.0, TABLE_TOP - half[2])
    collision_geom(world, "table.top", "box", half, top, "table", friction=friction)
    visual_geom(world, "box", (0.2275, 0.6025, 0.008), (x, 0.0, TABLE_TOP - 0.02), "table_edge")
    visual_geom(world, "box", (0.18, 0.50, 0.0005), (x, 0.0, TABLE_TOP), "cloth")
    for index, (along, across) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
        leg = (0.02, 0.02, 0.5 * TABLE_TOP - 0.015)
        where = (x + 0.19 * along, 0.56 * across, leg[2])
        collision_geom(world, f"table.leg{index}", "box", leg, where, "leg")
