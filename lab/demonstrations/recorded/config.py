"""Settings that all episodes of recorded runs in a data set share."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from common.episodes.episode_file import Operator
from common.errors import ConfigError


class RecordedConfig(BaseModel):
    """What a data set of recorded episodes has.

    Attributes:
        recorded: tells it from the settings of simulated trials.
        task: name of the task.
        operators: kinds of operators whose episodes may be in it.
        picture_size: width and height of the pictures [pixels]; None: there are none.
        keep_failures: whether episodes that are no success are kept too.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    recorded: Literal[True] = True
    task: str
    operators: tuple[Operator, ...]
    picture_size: tuple[int, int] | None
    keep_failures: bool = False

    def origin(self) -> dict[str, Any]:
        """Return the settings as JSON, as an episode's metadata holds them."""
        return self.model_dump(mode="json", include={"recorded", "task", "picture_size"})

    def with_operator(self, operator: Operator, *, mix: bool) -> "RecordedConfig":
        """Return the settings of a data set to which episodes of an operator are added.

        Raises:
            ConfigError: it has those of another, and they are not to be mixed.
        """
        if operator in self.operators:
            return self
        if not mix:
            raise ConfigError(
                f"the data set has episodes by {', '.join(self.operators)}, these are by "
                f"{operator}; choose another --out, or mix them knowingly with --mix"
            )
        return self.model_copy(update={"operators": (*self.operators, operator)})
