"""Run a network frame by frame, as in service: arrays in, arrays out."""

import numpy as np
import torch
from numpy.typing import NDArray

from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Decision

Memory = NDArray[np.float32]


class TorchRuntime:
    """Takes one recurrent step at a time with torch.

    It keeps nothing between two steps: the memory comes and goes with each. How many threads torch
    takes is the process's to say; beside a simulator it should be one.
    """

    def __init__(self, network: PolicyNetwork) -> None:
        self._network = network.eval()

    def step(
        self, observation: NDArray[np.float32], pictures: Picture, memory: Memory
    ) -> tuple[Decision, Memory]:
        """Return the decision for one frame and the memory after it.

        Args:
            observation: (n,) observation vector.
            pictures: (cameras, height, width, 3) of the policy's cameras, in their order.
            memory: array of :attr:`~services.policy.configuration.PolicySettings.memory_shape`
                after the frame before; zero at the start.
        """
        with torch.inference_mode():
            outputs, after = self._network(
                torch.from_numpy(observation)[None, None],
                torch.from_numpy(pictures)[None, None],
                torch.from_numpy(memory)[:, :, None],
            )
            parts = self._network.decide(outputs)
            hands, grasp, gait = (part[0, 0].numpy() for part in parts)
            return Decision(hands, grasp, gait), after[:, :, 0].numpy()
