"""Loads the network of a checkpoint into the runtime that a configuration chooses."""

from common.packages import require
from services.policy.checkpoint.exported import read_exported
from services.policy.checkpoint.manifest import Description, describe
from services.policy.runtimes.runtime import Backend, CachingRuntime, warm_up
from services.policy.serving.config import PolicyConfig, RuntimeName

_PACKAGES = {
    "torch": ("policy", "torch", "safetensors"),
    "onnx": ("onnx", "onnxruntime"),
    "openvino": ("openvino", "openvino"),
}
"""The extra of each runtime, and its packages."""


def require_runtime(name: RuntimeName) -> None:
    """Check that a runtime is installed.

    Raises:
        ConfigError: it is not; the message says how to install it.
    """
    require(f"--runtime {name}", *_PACKAGES[name])


def load_runtime(config: PolicyConfig) -> tuple[CachingRuntime, Description]:
    """Return a runtime of a checkpoint's network, warmed up, and what else the checkpoint holds.

    Raises:
        ConfigError: the runtime is not installed.
        CheckpointError: the checkpoint cannot be served, or has not been exported.
        PolicyError: the runtime cannot compute it as configured.
    """
    require_runtime(config.runtime)
    description = describe(config.checkpoint, config.kind)
    runtime = CachingRuntime(_backend(config, description))
    policy = description.manifest.policy
    frames = max(1, config.window_of(policy))
    warm_up(runtime, policy, frames, min(frames, config.steps_of(policy)))
    return runtime, description


def _backend(config: PolicyConfig, description: Description) -> Backend:
    checkpoint, device, threads = config.checkpoint, config.device, config.threads
    if config.runtime == "torch":
        from services.policy.runtimes.torch_backend import torch_backend

        return torch_backend(checkpoint, device, threads)
    exported = read_exported(checkpoint, description)
    if config.runtime == "onnx":
        from services.policy.runtimes.onnx_backend import OnnxBackend

        return OnnxBackend(exported, device, threads)
    from services.policy.runtimes.openvino_backend import OpenVinoBackend

    return OpenVinoBackend(exported, device, threads, config.precision)
