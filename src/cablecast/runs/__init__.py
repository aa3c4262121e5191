"""Run folders: settings, results, and how interrupted work resumes."""
