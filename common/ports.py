"""THE table of services: their names, ports and roles.

Every known service listens on its own TCP port, :data:`PORT_OFFSETS` above a base port; see
:mod:`common.transport.config` for who connects to whom. A new service needs a row here: its role
decides whether it counts as an operator, its offset where it listens.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

DEFAULT_BASE_PORT = 7448
"""The port of the first service of the table."""

ROUTER_OFFSET = -1
"""Where a router beside the services listens for clients, relative to the base port."""


class Role(StrEnum):
    """The part of a service or tool in the system."""

    PLANT = "plant"
    """Carries joint commands out and measures the state."""
    SENSOR = "sensor"
    """Publishes pictures of the robot's surroundings."""
    CONTROLLER = "controller"
    """Turns set-points into joint commands."""
    OPERATOR = "operator"
    """Gives set-points and gait requests; on the far side of the injected links."""
    OBSERVER = "observer"
    """Reads every topic and publishes only its own health."""
    REPLAY = "replay"
    """Publishes every topic of a recording, under another robot's name."""
    SERVER = "server"
    """Computes for a service that asks it, and publishes nothing. Like a tool it has no row in the
    table, so that there may be several."""
    TOOL = "tool"
    """A command that a person runs beside the services (`trill mark`, `trill latency`, `trill up`):
    reads what an observer reads. Tools have no row in the table and listen on no port of it."""


RUN_LIVE = (Role.PLANT, Role.SENSOR, Role.CONTROLLER, Role.OPERATOR)
"""Roles of the services that a live runner paces; an observer runs its own loop."""


@dataclass(frozen=True)
class KnownService:
    """One row of the table.

    Attributes:
        name: as in topic keys, options and tables of a configuration file.
        offset: of its port from the base port; never given to another service later.
        role: its part in the system.
    """

    name: str
    offset: int
    role: Role


SERVICES: tuple[KnownService, ...] = (
    KnownService("sim", 0, Role.PLANT),
    KnownService("wbc", 1, Role.CONTROLLER),
    KnownService("teleop", 2, Role.OPERATOR),
    KnownService("logger", 3, Role.OBSERVER),
    KnownService("monitor", 4, Role.OBSERVER),
    KnownService("policy", 5, Role.OPERATOR),
    KnownService("plant", 6, Role.PLANT),
    KnownService("bridge", 7, Role.OPERATOR),
    KnownService("cameras", 8, Role.SENSOR),
    KnownService("keyboard", 9, Role.OPERATOR),
    KnownService("replay", 10, Role.REPLAY),
    KnownService("headset", 11, Role.OPERATOR),
)
"""Every service that has a port.

``plant`` and ``bridge`` are reserved: they have no code yet.
``sim`` is the simulated plant and ``plant`` the driver of a real robot, so both have the role
PLANT; a system runs one of them.
"""

PORT_OFFSETS: Mapping[str, int] = {service.name: service.offset for service in SERVICES}
"""Ports by service; each listens on the base port plus its offset."""


def with_role(role: Role) -> tuple[str, ...]:
    """Return the names of the services with this role, in the order of the table."""
    return tuple(service.name for service in SERVICES if service.role is role)


OPERATORS = with_role(Role.OPERATOR)
"""Services that give set-points and gait requests."""
