"""Live camera: frames from a device, a file or a stream, its clock, and the track of a cast."""
