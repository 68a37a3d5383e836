"""THE table of queries: every key that can be asked for is declared here and nowhere else.

Keys are ``<robot>/<query name>/<answerer>``; asking ``<robot>/<query name>/*`` reaches everybody
who answers. The keys that are published stand in :mod:`common.topics`.
"""

from dataclasses import dataclass

from common.ports import RUN_LIVE, Role


@dataclass(frozen=True)
class Query:
    """One row of the table.

    Attributes:
        name: key without the robot and the answerer.
        answered_by: roles that answer it.
        asked_by: roles that ask it.
        doc: question and answer, for people.
        answerer: what the last part of the key names.
    """

    name: str
    answered_by: tuple[Role, ...]
    asked_by: tuple[Role, ...]
    doc: str
    answerer: str = "service"

    def key(self, robot: str, answerer: str) -> str:
        """Return the key on which ``answerer`` of ``robot`` answers; ``*`` stands for any."""
        return f"{robot}/{self.name}/{answerer}"


CLOCK = Query("clock", RUN_LIVE, RUN_LIVE, "times of receipt and answer, to compare two clocks")
LINKS = Query(
    "links", RUN_LIVE, (*RUN_LIVE, Role.TOOL), "list or change the delays injected on its inputs"
)
SCHEMA = Query(
    "schema",
    (*RUN_LIVE, Role.OBSERVER),
    (Role.OBSERVER, Role.TOOL),
    "keys, schema tags and JSON Schemas of what it publishes",
)
EPISODES = Query(
    "episodes",
    (Role.OBSERVER,),
    (Role.TOOL,),
    "which episode is being recorded, and the next one's number",
    answerer="recorder",
)
INFERENCE = Query(
    "inference",
    (Role.SERVER,),
    (Role.OPERATOR,),
    "a policy's frames and memory; what its network decides, and the memory after it",
    answerer="server",
)

ALL_QUERIES = (CLOCK, LINKS, SCHEMA, EPISODES, INFERENCE)
"""Every query there is."""


def query_table() -> str:
    """Format the table as Markdown."""
    rows = ["| query | answered by | asked by | |", "|---|---|---|---|"]
    rows += [
        f"| `{query.name}/<{query.answerer}>` | {', '.join(query.answered_by)} "
        f"| {', '.join(query.asked_by)} | {query.doc} |"
        for query in ALL_QUERIES
    ]
    return "\n".join(rows)
