"""The store: traces in MCAP, one table in Parquet, a manifest written last."""
