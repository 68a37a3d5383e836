"""Inputs of a service: one buffer per topic, freshness, subscriptions.

Injected latency takes effect here: :mod:`common.inbox.arrivals` passes the arrivals of an input
through the delay line (:mod:`common.links.delay`) of its link.
"""
