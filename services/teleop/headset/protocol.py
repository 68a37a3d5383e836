"""Messages between page and server; pure.

The page sends JSON texts, one of :data:`Incoming`, each with the page's own clock. The server sends
a status as JSON text, and stereo pictures as binary messages: the length of a JSON header as four
little-endian bytes, the header, the left JPEG file, the right one.
"""

import json
from collections import deque
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from common.errors import explain
from common.schemas import DeviceInput, HandController, Header
from services.teleop.errors import TeleopError
from services.teleop.headset.mapping import from_local_floor

LARGEST_MESSAGE = 4096
"""Of the page [bytes]; a sample of a headset has about 700."""
_Metres = Annotated[float, Field(ge=-100.0, le=100.0)]
_Unit = Annotated[float, Field(ge=-1.0, le=1.0)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]


class ProtocolError(TeleopError):
    """A page sent something that is no message of this protocol."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class TrackedPose(_Part):
    """A pose in WebXR's ``local-floor`` space: x right, y up, z back."""

    position: tuple[_Metres, _Metres, _Metres]
    quaternion: tuple[_Unit, _Unit, _Unit, _Unit] = Field(description="(w, x, y, z)")
    tracked: bool = Field(description="measured, not guessed")


class Controller(TrackedPose):
    """Pose of a controller's grip, and its buttons as in :class:`HandController`."""

    trigger: _Share = 0.0
    squeeze: _Share = 0.0
    lower: bool = False
    upper: bool = False
    stick: tuple[_Unit, _Unit] = (0.0, 0.0)
    stick_pressed: bool = False

    def hand(self) -> HandController:
        """Return it in the axes of :class:`DeviceInput`."""
        position, quaternion = _renamed(self)
        return HandController(
            position=position,
            quaternion=quaternion,
            tracked=self.tracked,
            trigger=self.trigger,
            squeeze=self.squeeze,
            lower=self.lower,
            upper=self.upper,
            stick=np.array(self.stick),
            stick_pressed=self.stick_pressed,
        )


class _Incoming(_Part):
    t: float = Field(description="page's clock when it was sent [ms]")


class Sample(_Incoming):
    """One sample of a headset and two controllers."""

    type: Literal["sample"]
    head: TrackedPose
    left: Controller
    right: Controller

    def device_input(self, stamp: int) -> DeviceInput:
        """Return it as a message; ``stamp`` is the robot time of what the operator saw [ns]."""
        position, quaternion = _renamed(self.head)
        return DeviceInput(
            header=Header(stamp=stamp),
            device="webxr",
            head_position=position,
            head_quaternion=quaternion,
            head_tracked=self.head.tracked,
            left=self.left.hand(),
            right=self.right.hand(),
        )


class Key(_Incoming):
    """A key of the keyboard operator, or a button of the page that stands for it."""

    type: Literal["key"]
    key: str = Field(min_length=1, max_length=12)


class Drag(_Incoming):
    """A hand dragged in the picture: its way since the drag began."""

    type: Literal["drag"]
    side: Literal["left", "right"]
    begins: bool = False
    across: float = Field(ge=-4.0, le=4.0, description="to the right, in heights of the picture")
    down: float = Field(ge=-4.0, le=4.0, description="likewise")
    ahead: float = Field(default=0.0, ge=-2.0, le=2.0, description="away from the camera [m]")


class Alive(_Incoming):
    """The page is there; sent when nothing else is."""

    type: Literal["alive"]


class Shown(_Incoming):
    """A picture was drawn, or could not be."""

    type: Literal["shown"]
    picture: int = Field(ge=0)


class Away(_Incoming):
    """The page is hidden or left: nobody looks at it."""

    type: Literal["away"]


Incoming = Sample | Key | Drag | Alive | Shown | Away
_ADAPTER: TypeAdapter[Incoming] = TypeAdapter(Annotated[Incoming, Field(discriminator="type")])


def parse(text: str) -> Incoming:
    """Return the message of a page.

    Raises:
        ProtocolError: it is none.
    """
    try:
        message = _ADAPTER.validate_json(text)
        if isinstance(message, Sample):
            # Checked here, where a refusal can still be told from the others of its page.
            message.device_input(0)
    except ValidationError as error:
        raise ProtocolError(f"not a message of the page: {explain(error)}") from error
    return message


def picture_message(header: dict[str, Any], left: bytes, right: bytes) -> bytes:
    """Return the binary message of a stereo picture."""
    head = json.dumps(header | {"left": len(left)}, separators=(",", ":")).encode()
    return b"".join((len(head).to_bytes(4, "little"), head, left, right))


class Punctuality:
    """Finds the messages of a page that were held up on their way; pure.

    Clocks of page and server are never compared: a message is as late as its way took longer than
    that of the fastest message of the last :data:`WINDOW_S`.
    """

    WINDOW_S = 30.0

    def __init__(self) -> None:
        self._fastest: deque[tuple[float, float]] = deque()

    def lateness(self, sent_ms: float, arrival_ns: int) -> float:
        """Return by how much a message is late [s].

        Args:
            sent_ms: page's clock when it was sent [ms].
            arrival_ns: server's clock when it came [ns].
        """
        arrival = 1e-9 * arrival_ns
        transit = arrival - 1e-3 * sent_ms
        fastest = self._fastest
        while fastest and fastest[-1][1] >= transit:
            fastest.pop()
        fastest.append((arrival, transit))
        while fastest[0][0] < arrival - self.WINDOW_S:
            fastest.popleft()
        return transit - fastest[0][1]


def _renamed(pose: TrackedPose) -> tuple[Any, Any]:
    return from_local_floor(np.array(pose.position), np.array(pose.quaternion))
