"""Records loops of users over MuJoCo's steps as runs of a store."""
