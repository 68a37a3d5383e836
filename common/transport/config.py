"""Configure the bus, and the ports by which services find each other.

Every known service has its own TCP port (:data:`~common.ports.PORT_OFFSETS` above a base port) on
which it listens, and keeps trying to connect to the ports before its own in the table; a pair is
thus connected by one of the two, whichever of them came first or came back last. So services on one
machine find each other without a router, without multicast and in any starting order. Several
stacks run side by side on different base ports. A service that is not in the table listens on a
port the system picks and connects to the whole table; two of these find each other by gossip
as long as a service of the table runs.

Two peers of which neither reaches the other's listening port exchange nothing, silently; a
service behind a router or a firewall therefore has to use ``mode="client"``, and by default looks
for a router on the port below the base port.
"""

import os
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, field_validator

from common.errors import ConfigError
from common.ports import DEFAULT_BASE_PORT, PORT_OFFSETS, ROUTER_OFFSET
from common.tables import overlaid, validated

SHARED_TABLES = ("bus", "links", "runtime")
"""Tables of a configuration file that are for every service."""

PORT_TABLE = "table"
"""As the only endpoint: those of the port table, whatever was configured elsewhere."""

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]+$", max_length=64)]
"""A robot's or a service's name: one chunk of a key expression."""


class BusConfig(BaseModel):
    """Connection of a process to the bus.

    Durations are whole milli- or microseconds because the transport takes them so. With the
    defaults a publisher never waits for a slow subscriber for more than a few milliseconds.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: Name = Field(default="draco3", description="first part of every key")
    mode: Literal["peer", "client", "router"] = Field(
        default="peer",
        description="peer: connects to the other services directly; client: reaches them through a "
        "router; router: passes messages on for clients",
    )
    host: str = Field(default="127.0.0.1", description="address of this machine's port table")
    base_port: int = Field(
        default=DEFAULT_BASE_PORT, ge=1024, le=65000, description="first port of the table"
    )
    listen: tuple[str, ...] | None = Field(
        default=None,
        description="endpoints to listen on; None or `table`: this service's port in the table",
    )
    connect: tuple[str, ...] | None = Field(
        default=None,
        description="endpoints to connect to; None or `table`: the ports before this service's "
        "own, or a client's router",
    )
    lease_ms: int = Field(
        default=1500, ge=100, le=60_000, description="a silent link is given up after this long"
    )
    retry_initial_ms: int = Field(
        default=100, ge=10, le=10_000, description="first pause before connecting is tried again"
    )
    retry_max_ms: int = Field(
        default=500, ge=10, le=60_000, description="longest pause; it grows by half each time"
    )
    patience_s: float = Field(
        default=20.0, ge=0.0, description="how long a client looks for its router when opening"
    )
    queue_size: int = Field(default=16, ge=1, le=16, description="batches queued per priority")
    drop_wait_us: int = Field(
        default=500, ge=0, le=100_000, description="a full queue delays a publisher this long"
    )
    drop_wait_fragments_us: int = Field(
        default=3000, ge=0, le=1_000_000, description="the same for a message of many fragments"
    )
    shared_memory: bool = Field(
        default=False, description="whether Zenoh may use shared memory on one host"
    )
    zenoh: dict[str, Any] = Field(
        default_factory=dict,
        description="laid over the generated Zenoh configuration, e.g. TLS or access control",
    )

    @field_validator("listen", "connect", mode="before")
    @classmethod
    def _of_table(cls, value: object) -> object:
        return None if value in (PORT_TABLE, (PORT_TABLE,), [PORT_TABLE]) else value

    def endpoint(self, offset: int) -> str:
        """Return the endpoint of the port at ``offset`` from the base port."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"tcp/{host}:{self.base_port + offset}"

    def listen_endpoints(self, service: str) -> list[str]:
        """Return the endpoints on which ``service`` listens; none for a client by default."""
        if self.listen is not None:
            return list(self.listen)
        if self.mode == "client":
            return []
        # Port 0: the system picks one.
        return [self.endpoint(PORT_OFFSETS.get(service, -self.base_port))]

    def connect_endpoints(self, service: str) -> list[str]:
        """Return the endpoints that ``service`` connects to."""
        if self.connect is not None:
            return list(self.connect)
        if self.mode == "client":
            return [self.endpoint(ROUTER_OFFSET)]
        known = service in PORT_OFFSETS
        own = PORT_OFFSETS.get(service, 1 + max(PORT_OFFSETS.values()))
        offsets = [offset for offset in PORT_OFFSETS.values() if offset < own]
        if not known and self.mode == "peer":
            # The router dials the table only, and behind it there may be operators and loggers.
            offsets.append(ROUTER_OFFSET)
        return [self.endpoint(offset) for offset in offsets]

    def zenoh_config(self, service: str) -> dict[str, Any]:
        """Return the Zenoh configuration of ``service``, JSON-serialisable."""
        queue_names = ("real_time", "interactive_high", "interactive_low", "data", "data_low")
        base: dict[str, Any] = {
            "mode": self.mode,
            "scouting": {
                "multicast": {"enabled": False},
                # Of two peers that discover each other only one connects: no crossing attempts.
                "gossip": {
                    "enabled": True,
                    "autoconnect_strategy": {"peer": {"to_peer": "greater-zid"}},
                },
            },
            "listen": {"endpoints": self.listen_endpoints(service)},
            "connect": {
                "endpoints": self.connect_endpoints(service),
                "timeout_ms": 0 if self.mode == "client" else -1,
                "exit_on_failure": False,
                "retry": {
                    "period_init_ms": self.retry_initial_ms,
                    "period_max_ms": self.retry_max_ms,
                    "period_increase_factor": 1.5,
                },
            },
            # Without multicast no peer is known yet that opening could wait for.
            "open": {"return_conditions": {"connect_scouted": False}},
            "timestamping": {"enabled": True},
            "transport": {
                "link": {
                    "tx": {
                        "lease": self.lease_ms,
                        "queue": {
                            "size": dict.fromkeys(queue_names, self.queue_size),
                            "congestion_control": {
                                "drop": {
                                    "wait_before_drop": self.drop_wait_us,
                                    "max_wait_before_drop_fragments": self.drop_wait_fragments_us,
                                },
                                "block": {"wait_before_close": 20_000},
                            },
                        },
                    }
                },
                "shared_memory": {"enabled": self.shared_memory},
            },
        }
        return overlaid(base, self.zenoh)


def read_config_file(path: Path, also: Iterable[str] = ()) -> dict[str, dict[str, Any]]:
    """Read a TOML file of tables: :data:`SHARED_TABLES` and one for each service.

    Services that may have a table are those of :data:`PORT_OFFSETS` and those in ``also``.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or holds anything but known tables.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(
            f"cannot read the configuration {path}: {error}; expected a TOML file with tables such "
            "as [bus], [links] and [runtime]"
        ) from error
    known = {*SHARED_TABLES, *PORT_OFFSETS, *also}
    for key, table in tables.items():
        if not isinstance(table, dict):
            raise ConfigError(f"{path}: expected only tables, got {key!r} outside of any")
        if key not in known:
            raise ConfigError(
                f"{path}: no table [{key}]; expected one of {', '.join(sorted(known))}"
            )
    return tables


_ENVIRONMENT = {
    "TRILL_ROBOT": "robot",
    "TRILL_MODE": "mode",
    "TRILL_HOST": "host",
    "TRILL_BASE_PORT": "base_port",
    "TRILL_LISTEN": "listen",
    "TRILL_CONNECT": "connect",
}


def bus_config(
    table: Mapping[str, Any] | None = None,
    arguments: Mapping[str, Any] | None = None,
    environment: Mapping[str, str] | None = None,
) -> BusConfig:
    """Combine defaults, a file's ``[bus]`` table, ``TRILL_*`` variables and arguments.

    Later ones win: arguments over environment over file over defaults. ``TRILL_LISTEN`` and
    ``TRILL_CONNECT`` are lists of endpoints separated by commas; an argument of None counts as
    not given.

    Raises:
        ConfigError: a value does not fit :class:`BusConfig`.
    """
    environment = os.environ if environment is None else environment
    values: dict[str, Any] = dict(table or {})
    for variable, field in _ENVIRONMENT.items():
        text = environment.get(variable)
        if not text:
            continue
        is_list = field in {"listen", "connect"}
        values[field] = split_list(text) if is_list else text
    values |= {key: value for key, value in (arguments or {}).items() if value is not None}
    return validated(BusConfig, values, what="the bus configuration")


def bus_of(config: Path | None = None, **arguments: Any) -> BusConfig:
    """Return the bus configuration of a system: :func:`bus_config` with its file.

    The file is ``config``, or that of ``TRILL_CONFIG``. ``arguments`` are fields of
    :class:`BusConfig`, of which None counts as not given.

    Raises:
        ConfigError: the file, a variable or an argument is wrong.
    """
    chosen = config or os.environ.get("TRILL_CONFIG")
    return bus_config(read_config_file(Path(chosen)).get("bus") if chosen else None, arguments)


def split_list(text: str) -> tuple[str, ...]:
    """Split a comma-separated list, ignoring blanks."""
    return tuple(part.strip() for part in text.split(",") if part.strip())
