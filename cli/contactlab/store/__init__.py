"""The store: traces in MCAP, one table in Parquet, and a manifest that is written last."""
