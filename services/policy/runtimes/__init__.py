"""What computes a network in service: torch, ONNX Runtime or OpenVINO, behind one interface."""
