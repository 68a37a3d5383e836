"""Picture encoders: feature maps, a spatial soft-max of key points, and a linear layer."""

from itertools import pairwise
from math import sqrt

import torch
from torch import Tensor, nn

from services.policy.configuration import ConvolutionConfig, ResNetConfig
from services.policy.networks.resnet import ResNet18


class Convolutions(nn.Module):
    """A few convolutions with batch normalisation.

    Attributes:
        channels: of the feature maps.
    """

    def __init__(self, config: ConvolutionConfig) -> None:
        super().__init__()
        self.channels = config.channels[-1]
        layers: list[nn.Module] = []
        sizes = pairwise((3, *config.channels))
        for (given, made), stride in zip(sizes, config.strides, strict=True):
            kernel = 3 if layers else 5
            conv = nn.Conv2d(given, made, kernel, stride, padding=kernel // 2, bias=False)
            layers += [conv, nn.BatchNorm2d(made), nn.ReLU(inplace=True)]
        self.layers = nn.Sequential(*layers)

    def forward(self, x: Tensor) -> Tensor:
        """Return the feature maps of pictures (n, 3, h, w)."""
        return self.layers(x)


class SpatialSoftmax(nn.Module):
    """Key points: where in the picture each channel is, on average (Finn et al., 2016)."""

    def __init__(self, channels: int, points: int) -> None:
        super().__init__()
        self.project = nn.Conv2d(channels, points, 1)
        # With the usual small weights the soft-max stays flat, its gradient stays small, and the
        # key points never leave the middle of the picture.
        nn.init.normal_(self.project.weight, std=1.5 * sqrt(2.0 / channels))
        nn.init.zeros_(self.project.bias)

    def heat(self, maps: Tensor) -> Tensor:
        """Return the logarithms (n, points, h, w) of where the points are; each map sums to 1."""
        # In 16 bits a soft-max over thousands of pixels loses its digits.
        logits = self.project(maps).float()
        return torch.log_softmax(logits.flatten(2), dim=2).view_as(logits)

    def forward(self, maps: Tensor) -> Tensor:
        """Return the points (n, 2 * points): all x, then all y, from -1 (left, top) to 1."""
        return self.of(self.heat(maps))

    @staticmethod
    def of(heat: Tensor) -> Tensor:
        """Return the points of the logarithms that :meth:`heat` returns."""
        heat = heat.exp()
        x, y = _axis(heat.shape[3], heat), _axis(heat.shape[2], heat)
        return torch.cat(((heat.sum(2) * x).sum(2), (heat.sum(3) * y).sum(2)), dim=1)


def _axis(count: int, like: Tensor) -> Tensor:
    """Return ``count`` numbers from -1 to 1; ``torch.linspace`` is exported to ONNX in 64 bits."""
    numbers = torch.arange(count, dtype=like.dtype, device=like.device)
    return numbers * (2.0 / max(count - 1, 1)) - 1.0


class Encoder(nn.Module):
    """Encodes the pictures of one camera."""

    def __init__(self, config: ResNetConfig | ConvolutionConfig) -> None:
        super().__init__()
        self.trunk = (
            ResNet18(config.width) if isinstance(config, ResNetConfig) else Convolutions(config)
        )
        self.points = SpatialSoftmax(self.trunk.channels, config.key_points)
        self.features = nn.Linear(2 * config.key_points, config.features)
        # As the pictures are: a processor core serves the paper's network in half the time.
        self.to(memory_format=torch.channels_last)

    def forward(self, pictures: Tensor) -> Tensor:
        """Return features (n, features) of 8-bit pictures (n, height, width, 3).

        The conversion is a part of the network, so that pictures are kept and sent in 8 bits, and
        training and service cannot differ in it.
        """
        return self.features(self.points(self.maps(pictures)))

    def maps(self, pictures: Tensor) -> Tensor:
        """Return the feature maps (n, channels, h, w) from which the key points are taken."""
        maps: Tensor = self.trunk(pictures.permute(0, 3, 1, 2).to(self.features.weight.dtype) / 255)
        return maps
