"""Stores in object storage: S3 and what speaks it, Google Cloud Storage, Azure Blob Storage."""
