"""Run folders: what was asked for, what came out, and how stopped work goes on."""
