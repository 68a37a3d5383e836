"""Injected latency: link specifications, delay lines, and their control at run time.

The inbox of the consumer (:mod:`common.inbox`) holds the messages back, by the delay lines of
:mod:`common.links.delay`.
"""
