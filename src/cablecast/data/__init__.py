"""Datasets of casts: one schema for D_tune, D_sim and D_real, stored as Parquet shards."""
