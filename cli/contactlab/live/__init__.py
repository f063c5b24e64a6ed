"""Pages that simulate: runs of a store in MuJoCo's WebAssembly build, in one HTML file."""
