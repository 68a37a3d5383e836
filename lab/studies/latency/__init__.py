"""How control latency and interpolation change what an operator can do: times and workload."""
