"""Side by side with Basilisk, both in one run: ``python -m benchmarks``. See README.md in this folder."""
