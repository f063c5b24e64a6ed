"""A stored run to look at: films, pictures, files for 3D viewers, the interactive viewer."""
