"""Formats the summary of a log, and the result of a repair, for a person or as JSON."""

import time
from dataclasses import asdict
from typing import Any

from common.operator.holds import Hold
from services.logger.read.delivery import total
from services.logger.read.episodes import Episode
from services.logger.read.log_info import LogInfo, SegmentInfo, TopicInfo
from services.logger.record.units import format_duration, format_size
from services.logger.repair.repair import RepairResult

_MAX_LINKS = 20
_MAX_HOLDS = 40


def info_lines(info: LogInfo) -> list[str]:
    """Return everything that ``trill info`` prints, section by section."""
    sections = [
        *(_head(info), _services(info), _topics(info), _episodes(info)),
        *(_holds(info), _links(info)),
    ]
    lines = [line for section in sections if section for line in (*section, "")]
    return lines[:-1]


def as_json(info: LogInfo) -> dict[str, Any]:
    """Return the same as JSON values."""
    return {
        "segments": [asdict(one) | {"path": str(one.path)} for one in info.segments],
        "whole": info.whole,
        "topics": [
            asdict(one) | {"rate": one.rate, "sent": one.count.sent, "missing": one.count.missing}
            for one in info.topics
        ],
        "services": info.boots,
        "episodes": [asdict(one) for one in info.episodes],
        "holds": [_hold_as_json(one) for one in info.holds],
        "pauses": [asdict(one) for one in info.pauses],
        "remarks": info.remarks,
        "links": [
            {"at_ns": one.at_ns, **one.change.model_dump(exclude={"header"})} for one in info.links
        ],
    }


def _hold_as_json(hold: Hold) -> dict[str, Any]:
    named = {"kind": hold.kind.name.lower(), "ended": hold.ended.name.lower()}
    return asdict(hold) | {"holder": hold.holder.source, "boot": hold.holder.boot} | named


def repair_lines(done: RepairResult) -> list[str]:
    """Return what the repair of one file found and did."""
    if not done.fault:
        if done.output != done.path:
            return [f"{done.path} is whole; copied to {done.output}"]
        return [f"{done.path} is whole; nothing was changed"]
    losses = done.losses
    lines = [f"{done.path}: {done.fault}", f"  saved {done.messages} messages to {done.output}"]
    if losses.partial_messages:
        lines.append(f"  {losses.partial_messages} of them from a chunk that was cut off")
    if losses.damaged_chunks or losses.unreadable_bytes or done.unknown:
        lines.append(
            f"  not readable: {losses.damaged_chunks} damaged chunks, {losses.unreadable_bytes} "
            f"other bytes, {done.unknown} messages of unknown topics"
        )
    count = total(done.report)
    lines.append(f"  delivery: {count.sent} sent, {count.missing} of them missing")
    if done.stated:
        lines.append(
            f"  NOT ALL COULD BE SAVED: the broken file should hold {done.stated} messages; "
            + ("it is kept for that reason" if done.kept else "keep it")
        )
    if done.kept is not None:
        lines.append(f"  the broken file is kept as {done.kept}")
    return lines


def _head(info: LogInfo) -> list[str]:
    first = info.segments[0]
    last = next((one for one in reversed(info.segments) if one.messages), first)
    origin = info.origin
    size = sum(one.size for one in info.segments)
    messages = sum(one.messages for one in info.segments)
    lines = [
        f"robot      {origin.get('robot', 'not known')}, recorded on "
        f"{origin.get('host', 'an unknown host')}",
        f"start      {_wall(first, first.start_ns)}",
        f"end        {_wall(last, last.end_ns)}",
        f"duration   {format_duration(info.seconds)}  ({messages} messages, {format_size(size)})",
        "file       " + "\n           ".join(_segment_line(one) for one in info.segments),
    ]
    chosen = [f"{n} {origin[n]}" for n in ("topics", "exclude") if origin.get(n)]
    if chosen:
        lines.append(f"selection  {'; '.join(chosen)}")
    lines += [f"pause      {pause}" for pause in info.pauses]
    return lines + [f"NOTE       {remark}" for remark in info.remarks]


def _segment_line(segment: SegmentInfo) -> str:
    if segment.whole:
        state = "whole, repaired" if segment.repaired else "whole"
    elif segment.open:
        state = "being recorded"
    elif segment.readable:
        state = "CUT OFF OR DAMAGED: trill repair saves it"
    else:
        state = "CUT OFF OR DAMAGED: nothing in it can be saved"
    return f"{segment.path}  {format_size(segment.size)}, {segment.messages} messages, {state}"


def _services(info: LogInfo) -> list[str]:
    if not info.boots:
        return []
    lines = ["services"]
    for source, boots in sorted(info.boots.items()):
        again = f", started {len(boots)} times" if len(boots) > 1 else ""
        lines.append(f"  {source or '(unnamed)'}: boot {', '.join(map(_boot, boots))}{again}")
    return lines


def _boot(boot: int) -> str:
    return f"{boot:016x}"[:8]


def _topics(info: LogInfo) -> list[str]:
    if not info.topics:
        return ["no messages"]
    width = max(len("topic"), *(len(topic.key) for topic in info.topics))
    lines = [
        f"{'topic':<{width}} {'messages':>9} {'rate':>9} {'size':>9} {'lost':>7} {'dropped':>7}"
        "  schema"
    ]
    lines += [_topic_line(topic, width) for topic in info.topics]
    count = total({topic.key: topic.count for topic in info.topics})
    lines.append(
        f"sent {count.sent} = recorded {count.recorded} + lost on the way {count.lost} + "
        f"dropped by the logger {count.dropped}"
        + (f"; {count.repeated} came twice" if count.repeated else "")
        + (f"; {count.late} came late" if count.late else "")
        + (f"; {count.earlier} sent before the recorder could hear them" if count.earlier else "")
    )
    return lines


def _topic_line(topic: TopicInfo, width: int) -> str:
    return (
        f"{topic.key:<{width}} {topic.messages:>9} {topic.rate:>6.1f} Hz "
        f"{format_size(topic.count.bytes):>9} {topic.count.lost:>7} {topic.count.dropped:>7}"
        f"  {', '.join(topic.schemas) or '-'}"
    )


def _episodes(info: LogInfo) -> list[str]:
    if not info.episodes:
        return []
    begin = info.segments[0].start_ns
    lines = [f"{'episode':>7} {'start':>9} {'length':>9}  {'outcome':<11} label"]
    lines += [_episode_line(one, begin, info.segments[-1].end_ns) for one in info.episodes]
    return lines


def _episode_line(one: Episode, begin_ns: int, end_ns: int) -> str:
    length = one.seconds if one.end_ns else 1e-9 * max(0, end_ns - one.start_ns)
    start = 1e-9 * (one.start_ns - begin_ns)
    return f"{one.episode:>7} {start:>8.2f}s {length:>8.2f}s  {one.outcome:<11} {one.label}"


def _holds(info: LogInfo) -> list[str]:
    """Return who had the robot."""
    if not info.holds:
        return []
    begin, last = info.segments[0].start_ns, info.segments[-1].end_ns
    width = max(len("operator"), *(len(one.name) for one in info.holds))
    lines = [f"{'operator':<{width}} {'start':>9} {'length':>9}  until"]
    for one in info.holds[:_MAX_HOLDS]:
        start, length = 1e-9 * (one.start - begin), 1e-9 * one.length(last)
        mark = "INTERVENTION, " if one.intervention else ""
        until = one.until or "the end of the log"
        lines.append(f"{one.name:<{width}} {start:>8.2f}s {length:>8.2f}s  {mark}{until}")
    if len(info.holds) > _MAX_HOLDS:
        lines.append(f"  … {len(info.holds) - _MAX_HOLDS} more")
    taken = [1e-9 * one.length(last) for one in info.holds if one.intervention]
    if taken:
        lines.append(f"{len(taken)} interventions, {sum(taken):.2f} s in all")
    return lines


def _links(info: LogInfo) -> list[str]:
    if not info.links:
        return []
    begin = info.segments[0].start_ns
    lines = ["injected links"]
    for link in info.links[:_MAX_LINKS]:
        change = link.change
        before = f" (before: {change.previous})" if change.previous else ""
        lines.append(
            f"  {1e-9 * (link.at_ns - begin):>8.2f}s {change.service}:{change.topic} = "
            f"{change.link or 'nothing'}{before} {change.reason}".rstrip()
        )
    if len(info.links) > _MAX_LINKS:
        lines.append(f"  … {len(info.links) - _MAX_LINKS} more")
    return lines


def _wall(segment: SegmentInfo, time_ns: int) -> str:
    wall = segment.wall_ns(time_ns)
    if not wall or not time_ns:
        return "not known"
    return time.strftime("%Y-%m-%d %H:%M:%S %z", time.localtime(1e-9 * wall))
