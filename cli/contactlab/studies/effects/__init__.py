"""The features and parts that a model needs, and a smaller model without the others."""
