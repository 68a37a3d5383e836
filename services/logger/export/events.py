"""Describes events (gaits, pushes, stops, episodes, links) in a line of text each."""

from common.schemas import (
    EpisodeMark,
    Estop,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    LinkChange,
    Message,
    PlantAction,
    PlantRequest,
)


def event_line(message: Message) -> tuple[str, bool]:
    """Return a line of text and whether it is a warning; an empty text if there is no event."""
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
        case Estop():
            text, warning = f"EMERGENCY STOP: {message.reason}", True
        case EpisodeMark():
            text = f"episode {message.episode}: {message.action.name} {message.label}".rstrip()
        case LinkChange():
            text = f"link {message.topic} to {message.service}: {message.link or 'no delay'}"
    return text, warning
