"""Figures and the HTML page that show a person what happened."""
