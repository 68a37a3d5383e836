"""ResNet18 (He et al., 2016) without its classifier, of any width.

At width 64 the parameters have the names and shapes of torchvision's ``resnet18``.
"""

from torch import Tensor, nn


class BasicBlock(nn.Module):
    """Two 3x3 convolutions around which the input is led."""

    def __init__(self, given: int, channels: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(given, channels, 3, stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(channels)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(channels)
        self.downsample = (
            nn.Sequential(
                nn.Conv2d(given, channels, 1, stride, bias=False), nn.BatchNorm2d(channels)
            )
            if stride != 1 or given != channels
            else None
        )

    def forward(self, x: Tensor) -> Tensor:
        """Return (n, channels, h / stride, w / stride) of (n, given, h, w)."""
        around = x if self.downsample is None else self.downsample(x)
        inner = nn.functional.relu(self.bn1(self.conv1(x)), inplace=True)
        # Of what lies between, nothing is needed for the gradient.
        return nn.functional.relu(self.bn2(self.conv2(inner)).add_(around), inplace=True)


class ResNet18(nn.Module):
    """The convolutional part of ResNet18: pictures to feature maps 1/32 as wide and high.

    Attributes:
        channels: of the feature maps, eight times the width.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        self.channels = 8 * width
        self.conv1 = nn.Conv2d(3, width, 7, 2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.maxpool = nn.MaxPool2d(3, 2, padding=1)
        self.layer1 = _layer(width, width, 1)
        self.layer2 = _layer(width, 2 * width, 2)
        self.layer3 = _layer(2 * width, 4 * width, 2)
        self.layer4 = _layer(4 * width, 8 * width, 2)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: Tensor) -> Tensor:
        """Return the feature maps (n, channels, h / 32, w / 32) of pictures (n, 3, h, w)."""
        x = self.maxpool(nn.functional.relu(self.bn1(self.conv1(x)), inplace=True))
        return self.layer4(self.layer3(self.layer2(self.layer1(x))))


def _layer(given: int, channels: int, stride: int) -> nn.Sequential:
    return nn.Sequential(BasicBlock(given, channels, stride), BasicBlock(channels, channels, 1))
