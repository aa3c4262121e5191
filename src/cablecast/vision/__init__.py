"""Vision: tags, calibration, the marker and its track, and the live camera with its clock.

The same code watches the real table and the rendered frames of the virtual laboratory.
"""
