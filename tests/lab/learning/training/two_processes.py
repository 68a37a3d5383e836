"""Trains as one of several processes: ``torchrun -m tests.lab.learning.training.two_processes``."""

import sys
from pathlib import Path

import torch

from lab.learning.training.train import train
from tests.lab.learning.training.support import job

if __name__ == "__main__":
    torch.set_num_threads(1)
    train(job(Path(sys.argv[1]), Path(sys.argv[2]), loss_frames=3, average=0.9))
