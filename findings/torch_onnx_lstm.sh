#!/bin/sh
# torch 2.13.0: the default ONNX exporter fixes an LSTM to the number of steps that it is shown.
#
# An LSTM over t steps, whose state comes as one tensor, is exported with t declared as dynamic. The
# graph keeps a dynamic input, but a Reshape in it has the number of steps of the example: with any
# other number ONNX Runtime fails. The older exporter (dynamo=False), which is deprecated, exports
# the same LSTM rightly.
#
# The older one has a surprise of its own: it puts the module that it was given, with all inside,
# back into that module's own state. A new module around a network in evaluation is in training, so
# that afterwards the network is, too, and its batch normalisations change with the next call.
#
# Seen on 2026-12-01 with torch 2.13.0 (CPU), onnx 1.23.2, onnxscript 0.7.2, onnxruntime 1.32.0 on
# Python 3.11, Linux x86-64:
#   dynamo=True   3 steps: as torch   1: fails   4: fails
#   dynamo=False  3 steps: as torch   1: as torch   4: as torch
#   network in training after the export: True
#
# Exits 0 if that is still so, 1 if it has changed. Installs into a temporary folder only; PYTHON
# names a Python that has the packages already.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python=${PYTHON:-}
if [ -z "$python" ]; then
    python3 -m venv "$work/venv"
    python=$work/venv/bin/python
    "$python" -m pip install --quiet torch==2.13.0 onnx==1.23.2 onnxscript==0.7.2 \
        onnxruntime==1.32.0
fi

cat > "$work/export.py" <<'PYTHON'
import io
import sys
import warnings

import numpy as np
import onnxruntime
import torch

warnings.simplefilter("ignore")


class Last(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.lstm = torch.nn.LSTM(5, 8, batch_first=True)

    def forward(self, x, memory):
        y, _ = self.lstm(x[None], (memory[0], memory[1]))
        return y[:, torch.tensor([-1])]


def outcome(session, module, steps):
    given = torch.randn(steps, 5), torch.zeros(2, 1, 1, 8)
    feed = dict(zip(("x", "memory"), (array.numpy() for array in given)))
    try:
        (got,) = session.run(None, feed)
    except Exception:
        return "fails"
    return "as torch" if np.allclose(got, module(*given).detach(), atol=1e-6) else "wrong"


def exported(module, **how):
    given = torch.randn(3, 5), torch.zeros(2, 1, 1, 8)
    file = io.BytesIO()
    torch.onnx.export(module, given, file, input_names=["x", "memory"], **how)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(
        file.getvalue(), options, providers=["CPUExecutionProvider"]
    )


module = Last().eval()
steps = torch.export.Dim("steps", min=1, max=100)
new = exported(module, dynamo=True, dynamic_shapes={"x": {0: steps}, "memory": None})
old = exported(module, dynamo=False, dynamic_axes={"x": {0: "steps"}})
found = [[outcome(session, module, count) for count in (3, 1, 4)] for session in (new, old)]
for name, (three, one, four) in zip(("dynamo=True ", "dynamo=False"), found):
    print(f"{name}  3 steps: {three}   1: {one}   4: {four}")

network = torch.nn.Sequential(torch.nn.Conv2d(1, 1, 1), torch.nn.BatchNorm2d(1)).eval()
around = torch.nn.Sequential(network)  # a new module is in training; what is in it is not
torch.onnx.export(around, (torch.zeros(1, 1, 2, 2),), io.BytesIO(), dynamo=False)
print("network in training after the export:", network.training)
still = found == [["as torch", "fails", "fails"], ["as torch"] * 3] and network.training
print("still so" if still else "changed: see above")
sys.exit(not still)
PYTHON
"$python" "$work/export.py" 2> "$work/errors" > "$work/said" || code=$?
grep -v '^\[torch.onnx\]' "$work/said" || cat "$work/errors" >&2
exit "${code:-0}"
