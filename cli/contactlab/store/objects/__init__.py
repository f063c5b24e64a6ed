"""Stores in object storage: S3 and compatible ones, Google Cloud Storage, Azure Blob Storage."""
