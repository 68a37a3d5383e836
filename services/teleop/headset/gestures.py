"""What a person means by buttons of a headset's controllers, besides mapped motion; pure."""

from collections.abc import Sequence
from typing import Final

from common.schemas import DeviceInput
from services.teleop.headset.mapping import Button

STOP_CHORD: Final = (
    Button.LEFT_UPPER,
    Button.LEFT_LOWER,
    Button.RIGHT_UPPER,
    Button.RIGHT_LOWER,
)
"""Pressed together, they are the emergency stop: Y, X, B and A."""
TAKE_AFTER: Final = 1.0
"""Time for which both triggers and clutches are held to take the robot from another [s]."""
HELD: Final = 0.6
"""Least value of a trigger or a squeeze that is held in this gesture."""


def stops(before: DeviceInput | None, device: DeviceInput) -> bool:
    """Return whether the emergency stop is pressed since this sample, even if it is the first."""
    first = before is None and all(button.held(device) for button in STOP_CHORD)
    return first or goes_down(before, device, STOP_CHORD)


def goes_down(before: DeviceInput | None, device: DeviceInput, buttons: Sequence[Button]) -> bool:
    """Return whether all ``buttons`` are held since this sample; the first one starts nothing."""
    held = all(button.held(device) for button in buttons)
    return held and before is not None and not all(button.held(before) for button in buttons)


def engages(before: DeviceInput | None, device: DeviceInput, squeeze: float) -> bool:
    """Return whether a hand's clutch has come up to ``squeeze`` with this sample."""
    if before is None:
        return False
    hands = ((before.left, device.left), (before.right, device.right))
    return any(old.squeeze < squeeze <= new.squeeze for old, new in hands)


class TakeGesture:
    """Both triggers and both clutches held for :data:`TAKE_AFTER`."""

    def __init__(self) -> None:
        self._since: float | None = None

    def update(self, device: DeviceInput | None, now: float) -> bool:
        """Return whether the gesture is complete with this sample.

        Args:
            device: the sample; None: it would mean nothing now.
            now: time on any steady clock [s].
        """
        hands = () if device is None else (device.left, device.right)
        if not hands or any(min(hand.squeeze, hand.trigger) < HELD for hand in hands):
            self._since = None
            return False
        if self._since is None:
            self._since = now
        if now - self._since < TAKE_AFTER:
            return False
        self._since = None
        return True
