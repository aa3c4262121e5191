"""Aiming: choose a cast, make it, learn from its landing, and correct."""
