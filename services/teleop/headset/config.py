"""Configure the operator in a browser or a headset."""

import argparse
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from common.tables import validated
from services.teleop.headset.mapping import MapperConfig
from services.teleop.keyboard.config import KeyboardConfig

LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})
"""Addresses that only programs of this machine reach."""
EVERY_ADDRESS = "0.0.0.0"
"""Listens on every IPv4 address of this machine."""

PACKAGES = ("aiohttp", "cryptography", "segno")
"""Of the extra ``headset``."""


class HeadsetConfig(BaseModel):
    """Configuration of the operator in a browser or a headset."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    address: str = Field(
        default="127.0.0.1",
        description="address to listen on; anything but loopback is served over HTTPS, and "
        "`0.0.0.0` is every address of this machine",
    )
    port: int = Field(default=8443, ge=0, le=65535, description="of the page; 0: any free one")
    names: tuple[str, ...] = Field(
        default=(),
        description="further names or addresses by which browsers reach this machine; they enter "
        "the certificate and are accepted as origins",
    )
    folder: Path | None = Field(
        default=None,
        description="folder of certificate and token (default: `trill/headset` in the user's data "
        "directory)",
    )
    pages: int = Field(default=16, ge=1, le=100, description="largest number of open pages")
    silence: float = Field(
        default=0.3,
        gt=0.0,
        le=1.0,
        description="silence of the driving page after which the hands hold and no set-points are "
        "sent; also the largest delay of a message that still counts [s]",
    )
    mapper: MapperConfig = MapperConfig()
    console: KeyboardConfig = KeyboardConfig()

    @property
    def secure(self) -> bool:
        """Whether the page is served over HTTPS."""
        return self.address not in LOOPBACK

    @property
    def data_folder(self) -> Path:
        """Folder of certificate and token."""
        base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
        return self.folder or Path(base) / "trill" / "headset"


def add_page_options(parser: argparse._ActionsContainer) -> None:
    """Add the options that say where the page is served."""
    parser.add_argument(
        "--lan", action="store_true", help="serve every address of this machine, over HTTPS"
    )
    parser.add_argument("--address", help="address to listen on ([headset] address)")
    parser.add_argument("--port", type=int, help="port of the page ([headset] port, 8443)")
    parser.add_argument(
        "--new-token", action="store_true", help="make links that were given out before useless"
    )


def page_config(arguments: argparse.Namespace, table: Mapping[str, Any]) -> HeadsetConfig:
    """Return the configuration: ``table`` of the file, under the options.

    Raises:
        ConfigError: a value is wrong.
    """
    address = EVERY_ADDRESS if arguments.lan else arguments.address
    given = {"address": address, "port": arguments.port}
    return validated(
        HeadsetConfig, table, {name: value for name, value in given.items() if value is not None}
    )
