"""The overhead camera: fiducial tags, calibration, the green marker, and the endpoint's track.

The same code watches the real table and the rendered frames of the virtual laboratory.
"""
