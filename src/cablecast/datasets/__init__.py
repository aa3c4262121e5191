"""Datasets of trials: one schema for D_tune, D_sim and D_real, stored as Parquet shards."""

from cablecast.datasets.reader import Dataset, read_dataset

__all__ = ["Dataset", "read_dataset"]
