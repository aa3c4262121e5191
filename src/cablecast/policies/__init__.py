"""Policies: from a target to an action."""

from cablecast.policies.forward_search import ForwardSearchPolicy, Plan

__all__ = ["ForwardSearchPolicy", "Plan"]
