"""Whether the plant's motors have the torque limits that the controller plans with; pure."""

from common.schemas import PlantState


def torque_misfit(planned: str, state: PlantState) -> str:
    """Return why the controller must not command this plant; empty: it may.

    A robot whose motors are weaker than the plans falls, and one that stands up to the height of
    other limits is not where the plans expect it. A plant that does not tell its limits is trusted.

    Args:
        planned: torque mode of the controller.
        state: of the plant.
    """
    if state.torque_mode in ("", planned):
        return ""
    return (
        f"the plant's torque limits are {state.torque_mode}, the controller's {planned}: start "
        "both with the same --torque-mode"
    )
