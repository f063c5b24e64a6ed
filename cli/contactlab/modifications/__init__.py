"""The catalogue of modifications: all that can be changed in a model, and who may change it."""
