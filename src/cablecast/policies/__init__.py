"""Policies: from a target to a motion."""

from cablecast.policies.base import Plan, Policy
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.policies.polar_casting import PolarCastingPolicy

__all__ = ["ForwardSearchPolicy", "Plan", "PolarCastingPolicy", "Policy"]
