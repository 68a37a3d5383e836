"""``trill teleop``: operate a running robot from a browser or a WebXR headset."""

import argparse

from common.packages import require
from lab.cli.bus import add_bus_options
from lab.cli.commands import Action
from services.teleop.headset.config import PACKAGES, add_page_options

TEXT = """Operate a running robot (trill up) from a browser or a WebXR headset. A link is printed;
the page behind it shows the robot's stereo pictures. On a desktop the pointer drags the hands, and
the keys are those of trill drive. In a headset a hand follows its controller while the squeeze
button is held, and buttons walk. Any number of pages may watch; one drives.

Without --lan only this machine reaches the page, and a headset on a USB cable after `adb reverse
tcp:8443 tcp:8443`. With --lan it is served over HTTPS with a certificate that is made at the first
start. The link holds a token, without which nobody gets in."""
EXAMPLES = """examples:
  trill up --task door/unlock          in one terminal
  trill teleop                         in another one; open the link
  trill teleop --lan                   for a headset in the same network
  trill teleop --lan --new-token       makes earlier links useless
  trill up --teleop web                both at once
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill teleop``."""
    add_page_options(parser)
    add_bus_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; returns the exit code."""
    require("trill teleop", "headset", *PACKAGES)
    from services.teleop.__main__ import main

    options = ["headset"]
    for name in ("config", "base_port", "robot", "address", "port"):
        if (value := getattr(arguments, name)) is not None:
            options += [f"--{name.replace('_', '-')}", str(value)]
    if arguments.connect:
        options += ["--mode", "client", "--connect", ",".join(arguments.connect)]
    options += [
        f"--{name}" for name in ("lan", "new-token") if getattr(arguments, name.replace("-", "_"))
    ]
    return main(options)


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
