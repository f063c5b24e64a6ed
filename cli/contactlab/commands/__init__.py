"""The commands: each module has the function of its name; one that groups several has them all."""
