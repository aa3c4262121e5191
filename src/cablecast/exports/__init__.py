"""Fitted cables as models of other simulators: one writer each, and what they say in comments."""
