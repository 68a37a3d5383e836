"""Describes events (gaits, pushes, stops, hand-overs, episodes, links) in a line of text each."""

from common.schemas import (
    AuthorityChange,
    AuthorityState,
    EpisodeMark,
    Estop,
    EstopClear,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    GuardMode,
    LinkChange,
    Message,
    PlantAction,
    PlantRequest,
    PlantStatus,
    Sender,
)


class EventLines:
    """Finds the events among a recording's messages, taken in in order.

    Emergency stops, claims and states are sent again and again; only a change is an event.
    """

    def __init__(self) -> None:
        """Start before the first message."""
        self._pressed: set[Sender] = set()
        self._stops: dict[Sender, int] = {}
        self._changes: dict[Sender, int] = {}

    def line(self, message: Message) -> tuple[str, bool]:
        """Return a line of text and whether it is a warning; an empty text if it is no event."""
        match message:
            case Estop():
                return self._button(message)
            case EstopClear():
                return _clear_line(message), True
            case PlantStatus():
                return self._plant(message)
            case AuthorityState():
                return self._authority(message)
        return _request_line(message)

    def _button(self, message: Estop) -> tuple[str, bool]:
        sender = message.header.sender
        if not message.pressed:
            self._pressed.discard(sender)
            return "", False
        if sender in self._pressed:
            return "", False
        self._pressed.add(sender)
        return f"EMERGENCY STOP by {sender.source}: {message.reason}", True

    def _plant(self, message: PlantStatus) -> tuple[str, bool]:
        sender = message.header.sender
        # A recorder that came later, or lost its oldest segments, hears the number of stops that
        # have long been ended.
        ended = message.stops if message.guard is not GuardMode.ESTOP else 0
        before = self._stops.get(sender, ended)
        self._stops[sender] = message.stops
        if message.stops <= before:
            return "", False
        by = f" by {message.stopped_by}" if message.stopped_by else ""
        reason = f": {message.stop_reason}" if message.stop_reason else ""
        return f"plant stopped{by} (stop {message.stops}){reason}", True

    def _authority(self, message: AuthorityState) -> tuple[str, bool]:
        sender = message.header.sender
        before = self._changes.get(sender)
        self._changes[sender] = message.changes
        # A recorder that came later hears who has the robot, but not of a change.
        if message.changes == (before or 0) or message.change is AuthorityChange.NONE:
            return "", False
        who = f"{message.holder} has the robot" if message.holder else "nobody has the robot"
        before_that = f", before that {message.previous}" if message.previous else ""
        why = message.change.name.lower()
        return f"{who} ({why}){before_that}", not message.holder


def _clear_line(message: EstopClear) -> str:
    reason = f": {message.reason}" if message.reason else ""
    return f"emergency stop {message.stops} cleared by {message.header.source}{reason}"


def _request_line(message: Message) -> tuple[str, bool]:
    text, warning = "", False
    match message:
        case GaitRequest():
            text = f"gait {message.gait.name} requested (#{message.request_id})"
        case GaitReply():
            text = f"gait {message.gait.name} {message.outcome.name} (#{message.request_id})"
            text += f": {message.reason}" if message.reason else ""
            warning = message.outcome in {GaitOutcome.REFUSED, GaitOutcome.ABORTED}
        case PlantRequest(action=PlantAction.PUSH):
            force = ", ".join(f"{one:.0f}" for one in message.force)
            text, warning = f"push of ({force}) N for {message.duration:g} s", True
        case PlantRequest():
            text = f"plant: {message.action.name}"
        case EpisodeMark():
            text = f"episode {message.episode}: {message.action.name} {message.label}".rstrip()
        case LinkChange():
            text = f"link {message.topic} to {message.service}: {message.link or 'no delay'}"
    return text, warning
