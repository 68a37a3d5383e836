"""What a controller says of who has the robot."""

from common.schemas import AuthorityChange, AuthorityState, Header, OperatorKind


def said(
    changes: int,
    change: AuthorityChange,
    holder: str = "",
    kind: OperatorKind = OperatorKind.POLICY,
    *,
    boot: int = 1,
) -> AuthorityState:
    """A state of the controller's run ``boot``; an operator's is the length of its name."""
    return AuthorityState(
        header=Header(boot=boot, source="wbc"),
        holder=holder,
        holder_boot=len(holder),
        kind=kind,
        changes=changes,
        change=change,
        previous="",
        previous_boot=0,
        since=0,
    )
