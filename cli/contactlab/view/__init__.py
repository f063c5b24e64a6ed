"""Shows stored runs: films, pictures, files for 3D viewers, the interactive viewer."""
